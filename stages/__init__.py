"""The stages of auvid; `registry` names them all, and those of each kind of campaign."""
