"""Findings about a log: damage, gaps, sensors that disagree, what it can be used for."""
