"""What logs of a fleet are, and which of them are of one dive."""
