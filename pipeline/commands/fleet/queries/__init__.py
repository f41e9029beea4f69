"""Questions to a fleet: logs of which something holds, and their recordings."""
