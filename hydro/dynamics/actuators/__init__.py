"""Forces of propellers, thrusters, fins and the buoyancy engine."""
