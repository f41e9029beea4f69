"""Dives of the twin of an ROV: plans, truths, logs, truth tables and report."""
