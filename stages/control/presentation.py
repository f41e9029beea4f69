"""Report and views of a control campaign.

Tables of tracking, paths desired and flown, inputs, margins, Monte Carlo; named
figures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import STATES, Array
from auvid.hydro.control.closed_loop import Performance
from auvid.hydro.control.plants import ControlledPlant, InputLimits
from auvid.hydro.dynamics.viscous.models import MODELS
from auvid.stages.columns import ATTITUDE, POSE, VELOCITY
from auvid.stages.control.flying import Flown
from auvid.stages.number_format import in_words, significant
from auvid.stages.presentation import Block, fold, panel, plot, remark, series, table, text

COLUMNS = {
    "X_thrust": "thrust_N",
    "delta_r": "rudder_rad",
    "delta_s_right": "stern_right_rad",
    "delta_s_left": "stern_left_rad",
    "propeller": "propeller_rev_s",
}
FORCES = tuple(
    f"disturbance_{axis}_{unit}"
    for axis, unit in zip("XYZKMN", ("N", "N", "N", "N_m", "N_m", "N_m"), strict=True)
)
INPUTS = {
    "X_thrust": "thrust",
    "delta_r": "rudder",
    "delta_s_right": "stern fin, starboard",
    "delta_s_left": "stern fin, port",
}
"""Inputs of a hybrid vehicle in words."""
SHOWN_HZ = 10.0


def input_column(name: str) -> str:
    """Return the column of schema `closed_loop` for an input."""
    return COLUMNS.get(name, f"{name}_rad" if name.startswith("fin_") else f"{name}_N")


def flight_table(plant: ControlledPlant, item: Flown) -> pa.Table:
    """One flight, ten samples per second."""
    flown, equilibrium = item.flown, item.schedule.equilibrium
    stride = max(1, round(1.0 / (SHOWN_HZ * item.case.step_s)))
    rows = slice(None, None, stride)
    place = flown.reference_s / equilibrium.step_s
    desired = np.column_stack(
        [
            np.interp(place, np.arange(len(equilibrium.t_s)), column)
            for column in equilibrium.chi[:, 6:].T
        ]
    )
    mass = np.interp(place, np.arange(len(equilibrium.t_s)), equilibrium.mass_kg)
    force = np.einsum("nij,nj->ni", plant.mass_matrix(mass), flown.disturbance)
    columns: dict[str, Any] = {"t_s": flown.t_s[rows]}
    columns |= dict(zip(POSE, flown.chi[rows, 6:].T, strict=True))
    columns |= dict(zip(VELOCITY, flown.chi[rows, :6].T, strict=True))
    columns |= {
        f"desired_{name}": values for name, values in zip(POSE, desired[rows].T, strict=True)
    }
    columns |= {
        "reference_s": flown.reference_s[rows],
        "mass_kg": mass[rows],
        "powered": flown.powered[rows],
    }
    columns |= {
        "position_error_m": item.errors.position_m[rows],
        "cross_track_m": item.errors.cross_track_m[rows],
    }
    columns |= dict(zip(FORCES, force[rows].T, strict=True))
    columns |= {input_column(name): flown.U[rows, i] for i, name in enumerate(plant.inputs.names)}
    return make_table("closed_loop", columns)


def gains_table(item: Flown, inputs: InputLimits) -> pa.Table:
    """Return the schedule at the design instants, one row per input."""
    schedule = item.schedule
    k, U = schedule.k[:: schedule.stride], schedule.equilibrium.U[:: schedule.stride]
    n, m = U.shape
    columns: dict[str, Any] = {
        "t_s": np.repeat(schedule.design_s, m),
        "input": list(inputs.names) * n,
        "U_eq": U.reshape(-1),
    }
    columns |= {f"k_{name}": k[:, :, i].reshape(-1) for i, name in enumerate(STATES)}
    return make_table("gains", columns)


def tracking_table(flown: Sequence[Flown], inputs: InputLimits) -> pa.Table:
    """Errors of every flight."""
    fins = _fins(inputs)
    rows: list[dict[str, Any]] = []
    for item in flown:
        e = item.errors
        rows.append(
            {
                "trajectory": item.case.name,
                "flight": item.flight.name,
                "designed_on": item.designed_on,
                "position_rms_m": float(e.position_rms_m),
                "cross_track_rms_m": float(e.cross_track_rms_m),
                "cross_track_max_m": float(e.cross_track_max_m),
                "steady_m": float(e.steady_m),
                "roll_rms_rad": float(e.attitude_rms_rad[0]),
                "pitch_rms_rad": float(e.attitude_rms_rad[1]),
                "yaw_rms_rad": float(e.attitude_rms_rad[2]),
                "limit_share_drive": float(e.at_limit[~fins].max(initial=0.0)),
                "limit_share_fins": float(e.at_limit[fins].max(initial=0.0)),
                "effort_drive": float(e.effort[~fins].max(initial=0.0)),
                "effort_fins_rad": float(e.effort[fins].max(initial=0.0)),
            }
        )
    return make_table("tracking_errors", {name: [row[name] for row in rows] for name in rows[0]})


def _fins(inputs: InputLimits) -> npt.NDArray[np.bool_]:
    return np.array([unit == "rad" for unit in inputs.units])


def figures(flown: Sequence[Flown], inputs: InputLimits) -> list[dict[str, Any]]:
    """Named figures: `QUANTITY, TRAJECTORY, FLIGHT[, designed on MODEL]`, in SI."""
    own, fins = flown[0].designed_on, _fins(inputs)
    rows: list[dict[str, Any]] = []
    for item in flown:
        e = item.errors
        after = "" if item.designed_on == own else f", designed on {item.designed_on}"
        where = f"{item.case.name}, {item.flight.name}{after}"
        note = f"{item.case.title}, {item.flight.title}"
        values = {
            "rms cross-track": (float(e.cross_track_rms_m), "m"),
            "largest cross-track": (float(e.cross_track_max_m), "m"),
            "share of fins at limit": (float(e.at_limit[fins].max(initial=0.0)), "1"),
            "largest drive": (float(item.flown.U[:, ~fins].max(initial=0.0)), inputs.units[0]),
            "mean drive": (float(item.flown.U[:, ~fins].mean()), inputs.units[0]),
        }
        if item.flight.clock or item.case.waiting is None:
            values["steady error"] = (float(e.steady_m), "m")
        if item.case.turn_s is not None and item.flown.reference_s[-1] > item.case.turn_s:
            values["cross-track at ends of turns"] = (at_turns(item), "m")
        without = _without_observer(item, flown)
        if without is not None:
            share = float(e.cross_track_rms_m) / float(without.errors.cross_track_rms_m)
            values["rms cross-track over that without observer"] = (share, "1")
        for name, (value, unit) in values.items():
            headline = item.flight.headline and name == "rms cross-track" and not after
            rows.append(
                {
                    "quantity": f"{name}, {where}",
                    "value": value if np.isfinite(value) else None,
                    "unit": unit,
                    "note": note,
                    "headline": headline,
                }
            )
    for item in _schedules(flown):
        frozen, used = (
            float(item.schedule.frozen_eigenvalues.real.max()),
            float(item.schedule.eigenvalues.real.max()),
        )
        words = "largest real part of A - B k along the trajectory"
        rows.append(
            {
                "quantity": f"slowest closed-loop pole, frozen gains, {item.case.name}",
                "value": frozen,
                "unit": "1/s",
                "note": words,
            }
        )
        rows.append(
            {
                "quantity": f"slowest closed-loop pole, gains in use, {item.case.name}",
                "value": used,
                "unit": "1/s",
                "note": words,
            }
        )
    return rows


def _without_observer(item: Flown, flown: Sequence[Flown]) -> Flown | None:
    """Return the flight that differs by the observer only.

    None for a flight without one, or where there is no such flight.
    """

    def conditions(other: Flown) -> tuple[Any, ...]:
        flight = other.flight
        force = [np.asarray(value).tolist() for value in vars(flight.force).values()]
        current = None if flight.current is None else flight.current.tolist()
        return other.case.name, other.designed_on, flight.clock, force, current

    if not item.flight.observer:
        return None
    return next(
        (
            other
            for other in flown
            if not other.flight.observer and conditions(other) == conditions(item)
        ),
        None,
    )


def at_turns(item: Flown) -> float:
    """Largest cross-track error where the reference completes a turn."""
    assert item.case.turn_s is not None
    turns = np.arange(1, int(item.flown.reference_s[-1] / item.case.turn_s) + 1) * item.case.turn_s
    return float(np.interp(turns, item.flown.reference_s, item.errors.cross_track_m).max())


def _schedules(flown: Sequence[Flown]) -> list[Flown]:
    """One flight per trajectory, on the vehicle's own design."""
    return list(
        {
            item.case.name: item
            for item in reversed(flown)
            if item.designed_on == flown[0].designed_on
        }.values()
    )[::-1]


def tracking_blocks(flown: Sequence[Flown], inputs: InputLimits) -> list[Block]:
    """Return the table of tracking errors, then the figures of each trajectory.

    Path, errors, attitude and inputs.
    """
    fins = _fins(inputs)
    heads: list[str | tuple[str, str]] = [
        "trajectory",
        "flight",
        "designed on",
        ("cross-track RMS", "m"),
        ("largest", "m"),
        ("from the place of that time, RMS", "m"),
        ("steady", "m"),
        ("fins at limit", "%"),
        ("drive at limit", "%"),
        ("RMS drive", inputs.units[0]),
    ]
    rows = [
        [
            item.case.title,
            item.flight.title,
            model_words(item.designed_on),
            *(
                _rounded(value)
                for value in (
                    item.errors.cross_track_rms_m,
                    item.errors.cross_track_max_m,
                    item.errors.position_rms_m,
                )
            ),
            _rounded(item.errors.steady_m),
            _rounded(100.0 * item.errors.at_limit[fins].max(initial=0.0)),
            _rounded(100.0 * item.errors.at_limit[~fins].max(initial=0.0)),
            _rounded(item.errors.effort[~fins].max(initial=0.0)),
        ]
        for item in flown
    ]
    note = (
        "Errors after the transient of each trajectory. A waiting reference does not keep to the"
        " clock: there only the distance to the path counts. Steady: largest distance over the last"
        " fifth."
    )
    blocks = [table("Tracking errors", heads, rows, note=note), *_designs_compared(flown)]
    for item in flown:
        if not np.isfinite(item.flown.chi).all():
            blocks.append(
                remark(
                    f"{item.case.title}, {item.flight.title}, designed on"
                    f" {model_words(item.designed_on)}: the vehicle was lost.",
                    "warning",
                )
            )
    own = [item for item in flown if item.designed_on == flown[0].designed_on]
    for name in dict.fromkeys(item.case.name for item in own):
        blocks += _trajectory_blocks([item for item in own if item.case.name == name], inputs)
    return blocks


def _designs_compared(flown: Sequence[Flown]) -> list[Block]:
    """Return the error of the first flight by the models that controllers are of."""
    first = flown[0]
    of_model = {
        item.designed_on: float(item.errors.cross_track_rms_m)
        for item in flown
        if (item.case.name, item.flight.name) == (first.case.name, first.flight.name)
    }
    if len(of_model) < 2:
        return []
    errors = ", ".join(
        f"{model_words(name)} {significant(error, 2)} m"
        for name, error in of_model.items()
        if np.isfinite(error)
    )
    words = (
        f"RMS cross-track by the model that the controller is designed on ({first.case.title},"
        f" {first.flight.title}): {errors}."
    )
    return [remark(words, "finding")]


def model_words(name: str) -> str:
    """Return what a controller is designed on, in words.

    >>> model_words("as_simulated"), model_words("identified (prestero)")
    ('as simulated', 'identified (Prestero)')
    """
    source, _, form = name.removesuffix(")").partition(" (")
    titles = {model.name: model.title for model in MODELS}
    title = titles.get(form, in_words(form))
    return f"{in_words(source)} ({title})" if form else titles.get(source, in_words(source))


def _rounded(value: Any) -> float | None:
    return float(f"{float(value):.4g}") if np.isfinite(value) else None


def _trajectory_blocks(flown: Sequence[Flown], inputs: InputLimits) -> list[Block]:
    case, equilibrium = flown[0].case, flown[0].schedule.equilibrium
    desired = equilibrium.chi[:, 6:9]
    kept = slice(0, int(max(item.flown.reference_s[-1] for item in flown) / equilibrium.step_s) + 1)
    plan = [series("desired", desired[kept, 1], desired[kept, 0], "desired")]
    depth = [series("desired", desired[kept, 0], desired[kept, 2], "desired")]
    for item in flown:
        position = item.flown.chi[:, 6:9]
        plan.append(series(item.flight.title, position[:, 1], position[:, 0], item.flight.name))
        depth.append(series(item.flight.title, position[:, 0], position[:, 2], item.flight.name))
    blocks = [
        plot(
            f"{case.title}: path in plan",
            [panel("north", "m", plan)],
            x_label="east",
            x_unit="m",
            look_for="flown on desired",
        ),
        plot(
            f"{case.title}: depth over north",
            [panel("depth", "m", depth)],
            x_label="north",
            x_unit="m",
        ),
        plot(
            f"{case.title}: distance to the path",
            [
                panel(
                    "cross-track",
                    "m",
                    [
                        series(
                            item.flight.title,
                            item.flown.t_s,
                            item.errors.cross_track_m,
                            item.flight.name,
                        )
                        for item in flown
                    ],
                )
            ],
            group=case.name,
        ),
    ]
    effort = [
        panel(
            INPUTS.get(name, in_words(name)),
            unit,
            [
                series(item.flight.title, item.flown.t_s, item.flown.U[:, i], item.flight.name)
                for item in flown
            ],
        )
        for i, (name, unit) in enumerate(zip(inputs.names, inputs.units, strict=True))
    ]
    blocks.append(
        plot(
            f"{case.title}: inputs", effort, group=case.name, look_for="where they stand at a limit"
        )
    )
    attitude = [
        panel(
            name.split("_")[0],
            "rad",
            [
                series(
                    item.flight.title,
                    item.flown.t_s,
                    item.flown.chi[:, 9 + i],
                    item.flight.name,
                )
                for item in flown
            ],
        )
        for i, name in enumerate(ATTITUDE)
    ]
    title = f"{case.title}: attitude"
    return [*blocks, *fold(title, [plot(title, attitude, group=case.name)])]


def design_blocks(flown: Sequence[Flown]) -> list[Block]:
    """Return equilibrium residuals, eigenvalues and margins of each controller."""
    rows = []
    for item in _schedules(flown):
        s = item.schedule
        residual = np.sqrt(np.mean(s.equilibrium.residual**2, axis=0))
        low, high, phase = s.margins[:, 0].max(), s.margins[:, 1].min(), s.margins[:, 2].min()
        watch = None if s.observer is None else _rounded(s.observer.poles.real.max())
        rows.append(
            [
                item.case.title,
                _rounded(s.frozen_eigenvalues.real.max()),
                _rounded(s.eigenvalues.real.max()),
                _rounded(s.eigenvalues.real.min()),
                watch,
                _rounded(low),
                _rounded(high) if high < 100.0 else "over 100",
                _rounded(np.degrees(phase)),
                _rounded(np.sqrt(np.sum(residual[:3] ** 2))),
                _rounded(np.sqrt(np.sum(residual[3:] ** 2))),
            ]
        )
    heads: list[str | tuple[str, str]] = [
        "trajectory",
        ("slowest pole, frozen gains", "1/s"),
        ("slowest pole, gains in use", "1/s"),
        ("fastest pole", "1/s"),
        ("slowest observer pole", "1/s"),
        "least gain factor",
        "largest gain factor",
        ("phase margin", "deg"),
        ("force left over", "N"),
        ("moment left over", "N m"),
    ]
    note = (
        "Poles of A - B k along the trajectory. Margins hold for changes in all inputs at once."
        " Left over: RMS of what the equilibrium inputs do not balance; the controller works"
        " against it."
    )
    return [table("Controllers", heads, rows, note=note)]


def monte_carlo_part(
    item: Flown, errors: Performance, cross_track: Array, source: str, duration_s: float
) -> tuple[list[Block], list[dict[str, Any]]]:
    """Spread of the tracking error over drawn models."""
    rms = errors.cross_track_rms_m
    lost = int((~np.isfinite(rms)).sum())
    finite = rms[np.isfinite(rms)]
    words = (
        f"{len(rms)} vehicles with coefficients drawn from {source}, {duration_s:g} s of"
        f" {item.case.title}, {item.flight.title}."
    )
    blocks: list[Block] = [text(words)]
    rows: list[dict[str, Any]] = [
        {"quantity": "Monte Carlo, members", "value": float(len(rms)), "unit": "1", "note": words},
        {"quantity": "Monte Carlo, members lost", "value": float(lost), "unit": "1", "note": words},
    ]
    if len(finite):
        low, middle, high = (float(value) for value in np.percentile(finite, [2.5, 50.0, 97.5]))
        blocks.append(
            remark(
                f"Half of {len(rms)} drawn vehicles stay within {middle:.2g} m (RMS) of their path,"
                f" 95 % of them between {low:.2g} and {high:.2g} m;"
                f" {'none is' if not lost else f'{lost} are'} lost.",
                "finding",
            )
        )
        rows.append(
            {
                "quantity": "Monte Carlo, rms cross-track",
                "value": middle,
                "unit": "m",
                "low": low,
                "high": high,
                "note": words,
                "headline": True,
            }
        )
        t = item.flown.t_s[: cross_track.shape[1]]
        bands = np.nanpercentile(cross_track[np.isfinite(rms)], [2.5, 50.0, 97.5], axis=0)
        lines = [
            series(name, t, values, role)
            for name, values, role in zip(
                ("2.5 %", "median", "97.5 %"), bands, ("band", "measured", "band"), strict=True
            )
        ]
        blocks.append(
            plot("Distance to the path over drawn models", [panel("cross-track", "m", lines)])
        )
    return blocks, rows


def views_of(tables: Mapping[str, pa.Table], inputs: InputLimits) -> dict[str, Any]:
    """Groups of the recording: errors, inputs and attitude of each flight."""
    groups = []
    for key in tables:
        columns = [input_column(name) for name in inputs.names]
        for entity, chosen, unit, tab in (
            ("errors", ["cross_track_m", "position_error_m"], "m", "Tracking"),
            ("attitude", [*ATTITUDE], "rad", "Attitude"),
            ("drive", columns[:1], inputs.units[0], "Inputs"),
            ("fins", [c for c in columns if c.endswith("_rad")], "rad", "Inputs"),
        ):
            if chosen:
                names = [name.rsplit("_", 1)[0] for name in chosen]
                groups.append(
                    {
                        "entity": f"{key}/{entity}",
                        "table": f"flights/{key}",
                        "columns": chosen,
                        "names": names,
                        "roles": names,
                        "tab": tab,
                        "unit": unit,
                    }
                )
    return {"groups": groups}
