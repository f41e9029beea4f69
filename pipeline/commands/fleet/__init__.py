"""`auvid fleet` and `auvid catalog`: a disk of dives, what they agree on, and where."""
