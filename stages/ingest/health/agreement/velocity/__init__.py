"""Checks of the velocity against the other sensors."""
