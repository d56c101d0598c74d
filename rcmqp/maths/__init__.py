"""Mathematics that knows nothing of robots: dual quaternions, smooth steps."""
