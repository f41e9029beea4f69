"""Drag without any thrust model, from legs that coast after their thrust has ended."""
