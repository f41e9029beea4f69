"""Plans: what a twin flies, and with which sensors it is watched."""
