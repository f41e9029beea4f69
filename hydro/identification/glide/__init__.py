"""Drag, lift and trim of a glider from settled glides."""
