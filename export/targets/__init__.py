"""The simulators that models are exported to, a file each."""

from auvid.export.exported import Target
from auvid.export.targets.draws import DRAWS
from auvid.export.targets.gazebo import GAZEBO
from auvid.export.targets.holoocean import HOLOOCEAN
from auvid.export.targets.json_file import JSON
from auvid.export.targets.mss import MSS
from auvid.export.targets.mujoco import MUJOCO
from auvid.export.targets.pvs import PVS
from auvid.export.targets.python import PYTHON
from auvid.export.targets.sitl import SITL
from auvid.export.targets.stonefish import STONEFISH
from auvid.export.targets.uuv import UUV

TARGETS: dict[str, Target] = {
    target.name: target
    for target in (
        GAZEBO, UUV, MSS, PVS, HOLOOCEAN, STONEFISH, MUJOCO, SITL, PYTHON, JSON, DRAWS,
    )
}  # fmt: skip
"""Target by its name on the command line."""
