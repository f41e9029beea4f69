"""Attitude, gyro and accelerometer against each other."""
