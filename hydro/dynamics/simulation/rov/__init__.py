"""A remotely operated vehicle with thrusters: physical truth, autopilot, dive, sensors."""
