"""Maximum likelihood from sensors as they are logged: output error and filter error."""
