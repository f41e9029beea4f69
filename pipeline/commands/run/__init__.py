"""`auvid run` and `auvid report`."""
