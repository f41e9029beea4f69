"""A vehicle as values: geometry, inertia, strip theory and lift of its fins.

Also what a log reports about its motors.
"""
