"""Axes of motion that a log measures, fitted by output error over chosen windows."""
