"""The first screen: what a run found and what it is good for."""
