"""Arms as data: a folder each, with robot.toml and, where it is ours, robot.urdf."""
