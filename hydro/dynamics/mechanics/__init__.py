"""Kinematics, rigid-body inertia, restoring forces and added mass: the terms of (2.60)
that need no vehicle.
"""
