"""Least squares from triangular factors: intervals, verdicts, priors and error
measures.
"""
