"""The vehicle document and its parts: body, actuators, sensors, shape."""
