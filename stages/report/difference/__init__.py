"""Differences between two runs, as tables and as a recording."""
