"""The world: an arm, its instrument, the trocar and its motion, obstacles, a camera."""
