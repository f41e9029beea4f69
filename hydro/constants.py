"""Physical and statistical constants that several files need.

The gravity of a vehicle (`Vehicle.gravity`) comes before the standard one wherever a
vehicle is at hand.
"""

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s^2] (3rd CGPM 1901)."""
STANDARD_PRESSURE_PA = 101_325.0
"""Standard atmosphere at sea level [Pa] (10th CGPM 1954)."""
FRESH_WATER_KG_M3 = 1000.0
"""Density of fresh water [kg/m^3] for depth from pressure."""
NORMAL_95 = 1.959964
"""Standard errors from the middle of a normal 95 % interval to its ends."""
NORMAL_SPREAD = 1.4826
"""Standard deviations in the median of the moduli of normal errors, rounded."""
