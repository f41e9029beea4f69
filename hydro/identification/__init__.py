"""Identification: signals to a common clock, sensor biases, least squares in one pass,
and what the data determine.
"""
