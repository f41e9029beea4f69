"""Motion from pose: frames, body velocity with its errors, faults of a track."""
