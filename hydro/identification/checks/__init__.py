"""Comparisons of signals with one another, for the health checks of a log."""
