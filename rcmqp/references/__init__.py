"""What is asked: views, paths, a hand at a device, and people who watch the camera."""
