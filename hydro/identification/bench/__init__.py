"""Bench experiments: single channels, pendulum swings and free decays."""
