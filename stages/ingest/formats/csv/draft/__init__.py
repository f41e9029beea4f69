"""A column map drafted from names and values of a CSV file."""
