"""`python -m pipeline` is `auvid`, for where the command is not on the path."""

from pipeline.cli import main

main()
