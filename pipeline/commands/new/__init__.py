"""`auvid new`: a workspace with an example campaign."""
