"""Viscous forces: the basis of terms, eight published models, coefficient tables."""
