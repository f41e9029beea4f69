"""A toy stage that workers of other processes can import."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.tables import make_table
from auvid.stages.base import Collection, Stage, port


@dataclass(frozen=True)
class Inputs:
    depth: Collection[pa.Table] = port("samples_depth", many=True)


@dataclass(frozen=True)
class Params:
    folder: str = ""


@dataclass(frozen=True)
class Outputs:
    pieces: dict[str, pa.Table] = port("samples_depth", many=True)


def doubled(inputs: Inputs, params: Params) -> Outputs:
    """Give every table twice as deep."""
    return Outputs({key: table(2.0 * column(each)) for key, each in inputs.depth.items()})


def refuses(inputs: Inputs, params: Params) -> Outputs:
    raise DataError("too short", value=3)


def breaks(inputs: Inputs, params: Params) -> Outputs:
    raise ZeroDivisionError("a fault of ours")


def dies_once(inputs: Inputs, params: Params) -> Outputs:
    """End the worker the first time, and give the tables the second."""
    if not (Path(params.folder) / "died").exists():
        (Path(params.folder) / "died").touch()
        os._exit(1)
    return doubled(inputs, params)


def column(samples: pa.Table) -> np.ndarray:
    return samples["z_m"].to_numpy()


def table(z_m: np.ndarray) -> pa.Table:
    return make_table("samples_depth", {"t_s": np.arange(z_m.size, dtype=float), "z_m": z_m})


def toy(run: object) -> Stage[Inputs, Params, Outputs]:
    return Stage(
        name="deepen",
        summary="Deepen",
        maps_over="campaign",
        inputs=Inputs,
        params=Params,
        outputs=Outputs,
        run=run,  # type: ignore[arg-type]
        no_views="a toy",
    )
