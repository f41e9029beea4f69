"""`python -m auvid` is `auvid`, for where the command is not on the path."""

from auvid.pipeline.cli import main

main()
