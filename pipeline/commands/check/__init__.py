"""`auvid check`: the health page of a log."""
