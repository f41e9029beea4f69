"""How a motion answers the outputs that drive it."""
