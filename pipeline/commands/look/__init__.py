"""What draws runs and logs: `auvid inspect`, and `auvid diff` of two of them."""
