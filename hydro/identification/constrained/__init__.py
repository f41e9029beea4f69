"""Fits within physical limits, and with priors, from the triangular factor."""
