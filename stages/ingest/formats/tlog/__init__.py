"""MAVLink telemetry logs."""
