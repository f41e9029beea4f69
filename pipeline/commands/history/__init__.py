"""`auvid history`: earlier runs of a campaign."""
