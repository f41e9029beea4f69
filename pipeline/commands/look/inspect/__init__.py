"""`auvid inspect`: a run or a log in the Rerun viewer, and pictures of the gallery."""
