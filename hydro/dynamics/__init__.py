"""Rigid body and hydrodynamic forces of an underwater vehicle, and its equations of
motion forward and inverse.

Arrays are float64 with the component on the last axis; all leading dimensions are a
batch: eta = [x y z phi theta psi], nu = [u v w p q r], tau = [X Y Z K M N]; SI, NED and
body FRD, SNAME symbols.
"""
