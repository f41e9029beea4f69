"""Signals before identification: splines, filters, clocks, biases, the state smoother."""
