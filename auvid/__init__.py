"""auvid: from an underwater vehicle's field logs to identified hydrodynamic models.

    import auvid

    print(auvid.check("dive.BIN"))                # findings of a log
    results = auvid.run("bluerov2_dvl")           # what is stale runs
    results["validate/error_table"]               # a pandas DataFrame with units
    model = results.model                         # the model to take
    model.coefficients                            # values, intervals, verdicts
    model.simulate(time, tau)                     # its motion
    auvid.open_model("bluerov2_wu_2018")          # a published set, to compare with
    auvid.fleet("fleet").runs                     # every dive of a disk, with its state

Names below load when they are first used. All raise `PipelineError` with file, field,
value, allowed and remedy, as the commands do.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from auvid import plots
    from auvid.data_schemas.errors import PipelineError
    from auvid.fitting import fit
    from auvid.fleets import Fleet, fleet
    from auvid.logs import LogContents, check, read_log
    from auvid.models import VehicleModel as Model
    from auvid.models import open_model
    from auvid.results import RunResults, open_run, run
    from auvid.scoring import score

__all__ = [
    "Fleet",
    "LogContents",
    "Model",
    "PipelineError",
    "RunResults",
    "check",
    "fit",
    "fleet",
    "open_model",
    "open_run",
    "plots",
    "read_log",
    "run",
    "score",
]

_PLACES = {
    "Fleet": "fleets.Fleet",
    "LogContents": "logs.LogContents",
    "Model": "models.VehicleModel",
    "PipelineError": "data_schemas.errors.PipelineError",
    "RunResults": "results.RunResults",
    "check": "logs.check",
    "fit": "fitting.fit",
    "fleet": "fleets.fleet",
    "open_model": "models.open_model",
    "open_run": "results.open_run",
    "read_log": "logs.read_log",
    "run": "results.run",
    "score": "scoring.score",
}
"""Public name -> where it is, counted from auvid."""


def __getattr__(name: str) -> object:
    """Return a public name, loaded on first use."""
    if name in _PLACES:
        # One BLAS thread: it must be set before numpy is loaded.
        import_module("auvid.pipeline")
        place, _, own = _PLACES[name].rpartition(".")
        value: object = getattr(import_module(f"auvid.{place}"), own)
        globals()[name] = value
        return value
    if name == "plots":
        return import_module("auvid.plots")
    raise AttributeError(f"module 'auvid' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
