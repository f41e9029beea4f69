"""One window of a leg as a compiled loop; `loop.run_window` is what others call."""
