"""Terms of McCarter 2014 (2.60) that need no vehicle.

Kinematics, rigid-body inertia, restoring forces and added mass.
"""
