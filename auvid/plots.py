"""Figures of motions, coefficients and scores, where matplotlib is installed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from auvid.data_schemas.errors import UsageError
from auvid.hydro.arrays import AXES
from auvid.models import VehicleModel
from auvid.stages.columns import VELOCITY

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["coefficients", "motion", "score"]


def motion(*frames: pd.DataFrame, labels: Sequence[str] = ()) -> Figure:
    """Draw the six velocities of motions, one over the other.

    Parameters
    ----------
    *frames : pandas.DataFrame
        Tables with ``t_s`` and velocities, as ``results["fuse/check/fused"]`` or
        `Model.simulate` gives them.
    labels : sequence of str, optional
        Names of the motions.

    Returns
    -------
    matplotlib.figure.Figure
        Three rows by two: u p, v q, w r.
    """
    figure = _figure(9.0, 6.0)
    panels = figure.subplots(3, 2, sharex=True)
    for place, name in enumerate(VELOCITY):
        panel = panels[place % 3, place // 3]
        for number, frame in enumerate(frames):
            label = labels[number] if number < len(labels) else None
            panel.plot(frame["t_s"], frame[name], label=label, linewidth=1.0)
        panel.set_ylabel(f"{name[0]} [{'m/s' if place < 3 else 'rad/s'}]")
    for panel in panels[-1]:
        panel.set_xlabel("t [s]")
    if labels:
        panels[0, 0].legend()
    return figure


def coefficients(model: VehicleModel) -> Figure:
    """Draw the coefficients that the data determine, with 95 % intervals by noise.

    Parameters
    ----------
    model : Model
        Its undetermined coefficients are named without a number.

    Returns
    -------
    matplotlib.figure.Figure
        A panel per axis; intervals are in parts of the value.
    """
    figure = _figure(9.0, 6.0)
    panels = figure.subplots(2, 3).ravel()
    table = model.coefficients
    for panel, axis in zip(panels, AXES, strict=True):
        rows = table[table["axis"] == axis]
        for place, (symbol, row) in enumerate(rows.iterrows()):
            if not row["determined"]:
                panel.text(0.0, place, f"{symbol}: {row['verdict']}", va="center", color="0.5")
                continue
            half = (row["high"] - row["low"]) / 2.0 / abs(row["value"])
            panel.errorbar(1.0, place, xerr=half, marker="o", capsize=3, color="C0")
            panel.text(0.0, place, f"{symbol} {row['value']:.3g} {row['unit']}", va="center")
        panel.set(title=axis, yticks=[], xlim=(0.0, 2.0), ylim=(-0.7, max(len(rows), 1) - 0.3))
        panel.set_xlabel("interval in parts of the value")
    return figure


def score(table: pd.DataFrame) -> Figure:
    """Draw J/J0 and the error of free runs by axis; below 1 is better than nothing.

    Parameters
    ----------
    table : pandas.DataFrame
        What `auvid.score` returns.

    Returns
    -------
    matplotlib.figure.Figure
        Two bars per axis and a line at 1.
    """
    figure = _figure(7.0, 3.5)
    panel = figure.subplots()
    places = np.arange(len(table))
    panel.bar(places - 0.2, table["J/J0"], 0.4, label="force, J/J0")
    panel.bar(places + 0.2, table["free_run"], 0.4, label="free run over plain guess")
    panel.axhline(1.0, color="0.4", linewidth=0.8)
    panel.set_xticks(places, list(table.index))
    panel.legend()
    return figure


def _figure(width: float, height: float) -> Figure:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise UsageError(
            "plots need matplotlib, which is not installed",
            remedy="pip install matplotlib, or auvid[plots]",
        ) from None
    return Figure(figsize=(width, height), layout="constrained")
