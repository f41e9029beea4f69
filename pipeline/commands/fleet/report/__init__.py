"""The page of a fleet: what to look at first, and the figures behind it."""
