"""The basis of viscous terms, the eight published models, and tables of their
coefficients.
"""
