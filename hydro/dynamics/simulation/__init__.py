"""Motion in time: compiled loop, free runs, bench motions, sensors."""
