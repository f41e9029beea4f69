"""Identified models as files of simulators, with what each cannot hold.

`write` writes the files of one target, `prepare` returns them as text.
"""

from auvid.export.losses import ExportLosses
from auvid.export.targets import TARGETS
from auvid.export.writing import Prepared, check_target, prepare, write

__all__ = ["TARGETS", "ExportLosses", "Prepared", "check_target", "prepare", "write"]
