"""`auvid diff`: two runs or golden tables side by side."""
