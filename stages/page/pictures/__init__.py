"""Drawings of the page: plots that zoom, and the pictures of the first screen."""
