"""auvid: from an underwater vehicle's field logs to identified hydrodynamic models."""

__version__ = "0.1.0"
