"""Rigid body and hydrodynamic forces of a vehicle, and its equations of motion.

The equations run forward and inverse.

Arrays are float64 with the component on the last axis; all leading dimensions are a
batch: eta = [x y z phi theta psi], nu = [u v w p q r], tau = [X Y Z K M N]; SI, NED and
body FRD, SNAME symbols.
"""
