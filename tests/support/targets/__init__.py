"""Evaluators of simulator targets: what a simulator does with an exported file.

Each reads the exported text by the rules of its target's own source and knows nothing of
the exporter. `python -m tests.support.targets` prints how far each is from its model, and
which of twelve planted mistakes it shows.
"""
