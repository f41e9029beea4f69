"""Least squares from triangular factors: intervals, verdicts, priors, errors."""
