"""Bodies that nothing on board drives: tows, coasts, free decays, drifts."""
