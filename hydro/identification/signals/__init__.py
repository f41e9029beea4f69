"""Signals before identification: splines, filters, clocks, biases, smoother."""
