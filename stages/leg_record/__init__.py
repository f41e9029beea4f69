"""The record of a leg for the fits of single axes: motion, force, windows."""
