"""A loop on a real arm, or on a simulated one in another process."""
