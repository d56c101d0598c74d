"""Robot arms as data: one folder an arm, with its robot.toml and, for the arms written here, its robot.urdf."""
