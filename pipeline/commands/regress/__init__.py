"""`auvid regress`: a run against its golden tables."""
