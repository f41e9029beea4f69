"""What the name of a CSV column means: a grammar of quantity, axis and unit."""
