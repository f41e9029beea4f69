"""Findings about a log: damage, gaps, sensors that disagree, possible uses."""
