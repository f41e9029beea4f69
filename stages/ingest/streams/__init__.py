"""Sensor streams in SI units and body axes, from the messages of each log format."""
