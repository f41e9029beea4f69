"""What several dives of a vehicle agree on, and what changed between them."""
