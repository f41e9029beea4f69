"""Estimation from recorded motion: signals, regression, bench methods."""
