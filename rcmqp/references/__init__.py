"""References for the camera: views, paths, a hand at a device, and simulated operators."""
