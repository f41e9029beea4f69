"""`auvid inspect`: a run or a log in the Rerun viewer, and the pictures of the gallery."""
