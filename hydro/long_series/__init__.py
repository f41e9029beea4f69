"""Work on long series: in threads, and in compiled loops."""
