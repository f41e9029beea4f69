"""Paths and trajectories: straight lines, circles, helices, Dubins paths."""
