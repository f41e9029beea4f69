"""The stages of auvid; `registry` has them all, and those of each kind of campaign."""
