"""CSV files with a column map."""
