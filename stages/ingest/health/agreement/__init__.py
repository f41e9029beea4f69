"""Checks of sensors against each other: gyro, gravity, other sources, motion."""
