"""Scenarios by name: each module has ``scenario(arm, flange=None)``, and runs by itself."""
