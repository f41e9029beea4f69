"""Gliders in the vertical plane: the steady balance of a glide, and the motion."""
