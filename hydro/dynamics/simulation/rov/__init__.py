"""A remotely operated vehicle: physical truth, autopilot, dive, sensors."""
