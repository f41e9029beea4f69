"""What drives the vehicle: its outputs, and how its motion answers them."""
