"""A vehicle as values: geometry, inertia, strip theory, lift of its fins, and what a
log tells of it.
"""
