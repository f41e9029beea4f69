"""`auvid reproduce`: tables of a thesis beside those of a twin."""
