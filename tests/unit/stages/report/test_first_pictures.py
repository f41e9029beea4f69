"""The pictures of the first screen show what the results are of."""

from __future__ import annotations

import re

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.tables import make_table
from auvid.stages.columns import POSITION
from auvid.stages.page.colours import ink
from auvid.stages.report.first_pictures import first_pictures
from auvid.stages.report.summary.figure_summary import summarise_results

SUMMARY = summarise_results({}, {}, {}, {"title": "a vehicle"})
T_S = np.linspace(0.0, 10.0, 21)


@pytest.mark.parametrize("chosen", ["linear", "quadratic", "linear and quadratic"])
def test_a_channel_is_drawn_with_the_damping_of_its_results(chosen: str) -> None:
    """Also where another damping lies nearer, as the one with most terms mostly does."""
    columns = {
        "t_s": T_S,
        "measured": np.sin(T_S),
        "force": np.zeros(T_S.size),
        "linear": np.sin(T_S) + 0.2,
        "quadratic": np.sin(T_S) + 0.1,
        "linear_and_quadratic": np.sin(T_S),
        "chosen": [chosen] * T_S.size,
    }
    tables = {"rlse/tank/channel_run": make_table("channel_run", columns)}
    signals, _ = first_pictures(tables, {}, {}, {}, SUMMARY)
    assert re.findall(r"tank: ([\w ]+) damping</b>", signals) == [chosen]
    deep = columns | dict.fromkeys(("measured", chosen.replace(" ", "_")), T_S)
    tables = {"rlse/tank/channel_run": make_table("channel_run", deep)}
    views = {"rlse/tank": {"groups": [{"entity": "rlse/tank/run", "unit": "m"}]}}
    signals, _ = first_pictures(tables, {}, {}, {}, SUMMARY, views)
    assert f'depth, {chosen} damping</b> <span class="unit">m</span>' in signals
    marks = re.findall(r'<span style="top:([\d.]+)%">(\d+)', signals)
    places = {int(depth): float(percent) for percent, depth in marks}
    assert places[0] < places[10], "deeper is further down"


def test_flights_differ_in_colour_from_each_other_and_from_what_is_desired() -> None:
    names = ("helix-undisturbed", "helix-side_force_clock", "helix-undisturbed_observer")
    place = dict.fromkeys([*POSITION, *(f"desired_{name}" for name in POSITION)], T_S)
    tables = {f"control/flights/{name}": pa.table({"t_s": T_S, **place}) for name in names}
    track, signals = first_pictures(tables, {}, {}, {}, SUMMARY)
    for picture in (track, signals):
        legend = picture[picture.index('<ul class="key">') : picture.index("</ul>")]
        roles = re.findall(r"--ink-([a-z_]+)", legend)
        assert len({ink(role).light for role in roles}) == len(roles) == 4
