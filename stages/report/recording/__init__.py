"""The Rerun recording of a run or a log."""
