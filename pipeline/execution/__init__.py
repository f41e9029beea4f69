"""Running stages: tasks, engines, locks, progress, and the generated dvc.yaml."""
