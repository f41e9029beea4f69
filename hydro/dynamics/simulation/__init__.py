"""Motion in time: compiled loop, free runs of identified models, bench motions,
sensors.
"""
