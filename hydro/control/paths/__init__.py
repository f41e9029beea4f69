"""Paths and trajectories that a controller follows: straight lines, circles, helices,
Dubins paths.
"""
