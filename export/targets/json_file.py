"""The model file itself."""

from __future__ import annotations

from auvid.export.exported import Exported, Request, Target

CONVENTION = (
    "Body axes x forward, y starboard, z down; world north, east, down; all of it in `frames` of"
    " the file; SI and radians. Damping has negative coefficients; added mass is given as"
    " derivatives (X_udot <= 0)."
)
_USAGE = """\
Begin at `frames.equation`: `dynamics` has inertia, buoyancy and actuators, and the viscous
force of an axis is the sum of `predictor` times the product of `factors` over
`coefficients`.

```python
import json, math

model = json.load(open("{name}.json"))
```
"""


def export(request: Request) -> Exported:
    """Return `NAME.json`, the model file as it is; nothing is lost."""
    return Exported(
        {f"{request.name}.json": request.model.sealed().model_dump_json(indent=1) + "\n"},
        (),
        CONVENTION,
        _USAGE.format(name=request.name),
    )


JSON = Target(
    "json",
    "the model file itself",
    "all",
    "none",
    export,
    lacking_axes=True,
    any_unit_of_mass=True,
)
