"""A small made-up run in memory, as the stages would leave it: sections, views, tables,
model cards. Seeded; nothing is physical.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from auvid.data_schemas.documents.model import assumed_quantities, parse
from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.records.models import ModelCard, RankingRecord
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.stages.base import collection
from auvid.stages.model_use import usable_for
from auvid.stages.presentation import equation, panel, plot, remark, section, series, table, text
from auvid.stages.report import Inputs
from auvid.stages.validate.ranking import rank
from tests.support.motions import vehicle_document

Array = npt.NDArray[np.float64]
AXES = ("X", "Y", "Z", "K", "M", "N")
UNITS = ("N", "N", "N", "N m", "N m", "N m")
MODELS = {
    "linear": ("Linear", 36, 0.62),
    "mcfarland": ("McFarland & Whitcomb", 216, 0.95),
    "gertler_hagen": ("Gertler & Hagen", 88, 0.88),
    "prestero": ("Prestero", 33, 0.66),
    "pitch_yaw": ("Pitch & Yaw", 100, 0.91),
    "coe": ("Coe", 24, 0.71),
    "uncoupled": ("Uncoupled", 22, 0.69),
    "fossen": ("Fossen", 12, 0.64),
}
RATE_HZ = 20.0
VERDICTS = ("identified", "weak", "not excited", "inseparable")


@dataclass
class ExampleRun:
    """The inputs of the report stage as plain mappings, so that a test can change any
    of them before `inputs()`.
    """

    campaign: dict[str, Any] = field(default_factory=dict)
    vehicle: Vehicle = field(default_factory=lambda: example_vehicle())
    logs: dict[str, LogInfo] = field(default_factory=dict)
    segments: dict[str, SegmentRecord] = field(default_factory=dict)
    fused: dict[str, pa.Table] = field(default_factory=dict)
    cards: dict[str, ModelCard] = field(default_factory=dict)
    errors: list[dict[str, Any]] = field(default_factory=list)
    free_run: list[dict[str, Any]] = field(default_factory=list)
    sections: dict[str, dict[str, Any]] = field(default_factory=dict)
    views: dict[str, dict[str, Any]] = field(default_factory=dict)
    tables: dict[str, pa.Table] = field(default_factory=dict)

    def error_table(self) -> pa.Table:
        """The rows of `errors` as the artefact."""
        names = (
            "use",
            "leg",
            "model",
            "axis",
            "n_bar",
            "rank",
            "samples",
            "sse",
            "mae",
            "mse",
            "rms",
            "mad",
            "j0",
            "ratio",
        )
        return make_table(
            "error_table", {name: [row[name] for row in self.errors] for name in names}
        )

    def ranking(self, choice: str | None = "") -> RankingRecord:
        """What validate makes of cards and errors, or with another model chosen."""
        record = rank(self.cards, self.errors, self.free_run, {})
        if choice == "":
            return record
        usable = next(
            (
                usable_for(m, self.cards[m.name], record.constant)
                for m in record.models
                if m.name == choice
            ),
            None,
        )
        return record.model_copy(update={"choice": choice, "usable": usable})

    def inputs(self) -> Inputs:
        """What the runner would hand to the stage."""
        return Inputs(
            campaign=self.campaign,
            vehicle=self.vehicle,
            provenance={
                "logs": {"dive": [{"name": "logs/dive.BIN", "content": "9f2c"}]},
                "vehicle": "51aa",
                "stages": {
                    "fuse": {
                        "code": "07d1",
                        "parameters": {
                            "method": "kinematic",
                            "cutoff_hz": 1.0,
                            "as_published": False,
                        },
                    }
                },
                "packages": {"numpy": "2.4.6"},
            },
            log_info=collection(self.logs),
            segment=collection(self.segments),
            fused=collection(self.fused),
            model_card=collection(self.cards),
            ranking=self.ranking(),
            sections=collection(self.sections),
            views=collection(self.views),
            tables=collection(self.tables),
            results=collection({}),
        )


def example_run(seconds: Mapping[str, float] | None = None) -> ExampleRun:
    """Two segments of one log (or those of `seconds`: name -> length), eight models,
    every kind of block.
    """
    lengths = dict(seconds or {"train": 90.0, "check": 40.0})
    run = ExampleRun(campaign=_campaign(), vehicle=example_vehicle())
    start = 0.0
    for name, length in lengths.items():
        run.segments[name] = _segment(
            name, "validation" if name == "check" else "training", start, length
        )
        start += length
    run.logs["dive"] = _log(start)
    run.cards = {name: _card(name) for name in MODELS}
    run.errors = [
        row for use in ("validation", "training") for row in _error_rows(use, tuple(lengths))
    ]
    _add_ingest(run, start)
    for index, name in enumerate(lengths):
        _add_segment(run, name, lengths[name], np.random.default_rng(index))
    _add_campaign(run)
    return run


def _campaign() -> dict[str, Any]:
    return {
        "kind": "identification",
        "title": "A made-up dive with a Doppler velocity log",
        "notes": (
            "130 s of slow motion at 13.5 m depth. Mass and thrust curve are assumed, so the"
            " coefficients scale with them."
        ),
        "vehicle": "bluerov2_heavy",
        "logs": [{"id": "dive", "file": "logs/dive.BIN"}],
        "legs": [
            {"id": "train", "log": "dive", "use": "training"},
            {"id": "check", "log": "dive", "use": "validation"},
        ],
        "stages": {"fuse": {"method": "kinematic", "cutoff_hz": 1.0}, "synthesise": {"trim": True}},
    }


def with_own_damping(card: ModelCard, verdict: str, axes: str = "XYZKMN") -> ModelCard:
    """Return the card with the term v of some axes in place of u in X ... r in N."""
    changed = {}
    for (axis, part), own in zip(card.axes.items(), "uvwpqr", strict=True):
        terms = [
            item.model_copy(update={"term": own, "verdict": verdict}) if item.term == "v" else item
            for item in part.terms
        ]
        changed[axis] = part.model_copy(update={"terms": terms}) if axis in axes else part
    return card.model_copy(update={"axes": changed})


def example_vehicle(**assumed: object) -> Vehicle:
    """Return a vehicle of which the mass and these values are assumed; __ parts keys."""
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    for place, _ in assumed_quantities(parse(VehicleDocument, document)):
        _part(document, place)["assumed"] = False
    document["title"] = "BlueROV2 Heavy"
    for name, value in {"rigid_body__mass": 13.5, **assumed}.items():
        _part(document, name.split("__")).update(value=value, assumed=True)
    return vehicle_from_document(document)


def _part(document: dict[str, Any], place: Sequence[str]) -> dict[str, Any]:
    for key in place:
        document = document[key]
    return document


def _log(seconds: float) -> LogInfo:
    return LogInfo.model_validate(
        {
            "log": "dive",
            "files": [
                {
                    "name": "dive.BIN",
                    "format": "dataflash",
                    "size_bytes": 8_123_456,
                    "record_bytes": 8_123_456,
                    "definition_bytes": 0,
                    "skipped": [],
                    "status": "truncated",
                    "seconds_lost": 0.4,
                }
            ],
            "status": "truncated",
            "start_us": 61_000_000,
            "end_us": 61_000_000 + int(seconds * 1e6),
            "utc_offset_us": None,
            "vehicle": "ArduSub 4.5.0",
            "parameters": {"FRAME_CONFIG": 2.0},
            "accelerometer": "specific_force",
            "streams": {},
            "counts": {"IMU": 6500},
            "notes": ["The clock starts 61 s after boot."],
        }
    )


def _segment(name: str, use: str, start: float, length: float) -> SegmentRecord:
    return SegmentRecord.model_validate(
        {
            "id": name,
            "leg": name,
            "log": "dive",
            "use": use,
            "start_us": 61_000_000 + int(start * 1e6),
            "leg_start_s": start,
            "duration_s": length,
            "margins_s": [0.0, 0.0],
            "samples": int(length * RATE_HZ),
            "rate_hz": RATE_HZ,
            "lags_s": {"velocity": 0.15},
            "smoothing": {},
            "gaps": [],
            "notes": [],
        }
    )


def _card(name: str) -> ModelCard:
    title, terms, _ = MODELS[name]
    axes = {}
    for index, (axis, unit) in enumerate(zip(AXES, UNITS, strict=True)):
        coefficients = [
            {
                "term": term,
                "unit": coefficient_unit(axis, term),
                "value": None if verdict == "not excited" else -3.5 * (index + 1),
                "standard_error": None if verdict == "not excited" else 0.4,
                "verdict": verdict,
                "inseparable_from": ["u*|u|"] if verdict == "inseparable" else [],
            }
            for term, verdict in zip(("u", "v", "w", "u*|v|"), VERDICTS, strict=True)
        ]
        axes[axis] = {
            "unit": unit,
            "samples": 1800,
            "rank": 3,
            "condition": 12.0,
            "j0": 4.0,
            "j": 1.5,
            "excitation": "not excited" if axis in "KM" else "weak" if axis == "N" else "excited",
            "terms": coefficients,
            "combinations": [],
            "covariance": {"terms": [], "lower": []},
        }
    return ModelCard.model_validate(
        {
            "name": name,
            "title": title,
            "vehicle": "bluerov2_heavy",
            "source": "McCarter 2014, chapter 3",
            "n_bar": terms,
            "n_bar_declared": terms,
            "rank": terms - 2,
            "samples": 1800,
            "trim": True,
            "assumed": ["mass", "inertia", "thrust curve"],
            "axes": axes,
            "not_applicable": [],
            "conditions": {
                name: {"rms": 0.2, "low": -0.4, "high": 0.5, "threshold": 0.03} for name in "uvwpqr"
            },
            "predictor": {},
        }
    )


def _error_rows(use: str, segments: tuple[str, ...]) -> list[dict[str, Any]]:
    rows = []
    for leg in ("all", *segments):
        for place, (name, (_, terms, total)) in enumerate(MODELS.items()):
            for index, axis in enumerate(("all", *AXES)):
                ratio = (
                    total
                    * (0.5 if use == "training" else 1.0)
                    * (1 + 0.12 * index * (-1) ** (index + place))
                )
                ratio += 0.6 if use == "validation" and axis in "KM" else 0.0
                j = 4.0 * ratio
                row = {
                    "use": use,
                    "leg": leg,
                    "model": name,
                    "axis": axis,
                    "n_bar": terms,
                    "rank": terms - 2,
                    "samples": 800,
                }
                rows.append(
                    {
                        **row,
                        "sse": 800 * j**2,
                        "mae": 0.8 * j,
                        "mse": j**2,
                        "rms": j,
                        "mad": 0.6 * j,
                        "j0": 4.0,
                        "ratio": ratio,
                    }
                )
    return rows


def _signals(length: float, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    t = np.arange(int(length * RATE_HZ)) / RATE_HZ
    truth = np.column_stack(
        [
            0.3 * np.sin(0.25 * (index + 1) * t + index) * (1 + 0.3 * np.sin(0.05 * t))
            for index in range(6)
        ]
    )
    return t, truth, truth + 0.03 * rng.standard_normal(truth.shape)


def _add_ingest(run: ExampleRun, seconds: float) -> None:
    time_us = 61_000_000 + np.arange(0, int(seconds * 1e6), 5_000_000)
    words = [f"EKF3 lane {index} active" for index in range(time_us.size)]
    run.tables["ingest/dive/events"] = make_table("events", {"time_us": time_us, "text": words})
    run.tables["ingest/dive/mode"] = make_table(
        "mode", {"time_us": time_us[:1], "mode": ["MANUAL"]}
    )
    rows = [["imu", 6500, 50.0, 0.02], ["velocity", 1040, 8.0, 0.41], ["depth", 1300, 10.0, None]]
    blocks = [
        remark("Every byte of the file is accounted for; the last record is cut off.", "finding"),
        table(
            "Streams",
            ["stream", "samples", ("rate", "Hz"), ("longest gap", "s")],
            rows,
            note="Taken from the preferred source.",
        ),
        remark("The velocity stream has a gap of 0.41 s at 77 s.", "warning"),
    ]
    run.sections["ingest/dive"] = section(
        "Log dive", blocks, order=10, look_for="Rates as the sensors promise, and no long gaps."
    )


def _add_segment(run: ExampleRun, name: str, length: float, rng: np.random.Generator) -> None:
    t, truth, noisy = _signals(length, rng)
    run.fused[name] = run.tables[f"fuse/{name}/fused"] = _fused_table(t, truth)
    run.tables[f"resample/{name}/resampled"] = _resampled_table(t, noisy)
    clock = t + float(run.segments[name].leg_start_s)
    symbols = (
        ("u", "m/s"),
        ("v", "m/s"),
        ("w", "m/s"),
        ("p", "rad/s"),
        ("q", "rad/s"),
        ("r", "rad/s"),
    )
    panels = [
        panel(
            symbol,
            unit,
            [
                series("raw", clock, noisy[:, index], "raw"),
                series("fused", clock, truth[:, index], "fused"),
            ],
        )
        for index, (symbol, unit) in enumerate(symbols)
    ]
    blocks = [
        text(
            "Velocity from the Doppler log, rates from the gyro, one zero-phase filter on all"
            " channels."
        ),
        plot(
            "Raw against fused",
            panels,
            group="time",
            look_for="The fused line follows the raw one without lag.",
        ),
        table(
            "Gyro bias", ["axis", ("bias", "rad/s")], [["p", 1.2e-4], ["q", -3.4e-4], ["r", 7.7e-5]]
        ),
    ]
    run.sections[f"fuse/{name}"] = section(f"State, raw against fused: {name}", blocks, order=30)
    columns = {"u_m_s": "u", "v_m_s": "v", "w_m_s": "w"}
    run.views[f"fuse/{name}"] = {
        "groups": [
            {
                "entity": f"state/velocity/{role}",
                "table": artefact,
                "columns": list(columns),
                "names": [f"{s} {role}" for s in columns.values()],
            }
            | {"roles": [role] * 3, "tab": "State", "unit": "m/s"}
            for role, artefact in (("raw", "resampled"), ("fused", "fused"))
        ]
    }
    parts = ("rigid_body_inertia", "added_mass_inertia", "restoring", "thrusters", "tau_bar")
    forces = [
        panel(
            axis,
            unit,
            [
                series(part, clock, 4 * np.roll(truth[:, index], 7 * place), part)
                for place, part in enumerate(parts)
            ],
        )
        for index, (axis, unit) in enumerate(zip(AXES, UNITS, strict=True))
    ]
    meaning = (
        "What the rigid body does, less what gravity and actuators explain, is left for the viscous"
        " model."
    )
    blocks = [
        equation(r"\bar\tau = M\dot\nu + C(\nu)\nu - \tau_G(\eta) - \tau_U(\nu, u)", meaning),
        plot("Residual force and its components", forces, group="time"),
    ]
    run.sections[f"residual/{name}"] = section(f"Residual force: {name}", blocks, order=40)
    run.tables[f"validate/predictions/{name}"] = _predictions(name, t, truth)


def _fused_table(t: Array, nu: Array) -> pa.Table:
    names = ["u_m_s", "v_m_s", "w_m_s", "p_rad_s", "q_rad_s", "r_rad_s"]
    pose = np.column_stack(
        [
            np.cumsum(nu[:, :3], axis=0) / RATE_HZ + [0, 0, 13.5],
            0.1 * np.sin(t),
            0.1 * np.cos(t),
            0.02 * t,
        ]
    )
    pose_names = ["x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad"]
    columns = {
        "t_s": t,
        **dict(zip(pose_names, pose.T, strict=True)),
        **dict(zip(names, nu.T, strict=True)),
    }
    for name in pose_names:
        columns[name.replace("_m", "_dot_m_s").replace("_rad", "_dot_rad_s")] = np.zeros(t.size)
    for name in names:
        columns[name.replace("_m_s", "_dot_m_s2").replace("_rad_s", "_dot_rad_s2")] = np.zeros(
            t.size
        )
    return make_table("fused", columns)


def _resampled_table(t: Array, nu: Array) -> pa.Table:
    zero = np.zeros(t.size)
    names = (
        "z_m",
        "z_dot_m_s",
        "phi_rad",
        "theta_rad",
        "psi_rad",
        "phi_dot_rad_s",
        "theta_dot_rad_s",
        "psi_dot_rad_s",
    )
    return make_table(
        "resampled",
        {
            "t_s": t,
            **dict.fromkeys(names, zero),
            "u_m_s": nu[:, 0],
            "v_m_s": nu[:, 1],
            "w_m_s": nu[:, 2],
        },
    )


def _predictions(name: str, t: Array, truth: Array) -> pa.Table:
    columns = ["tau_X_N", "tau_Y_N", "tau_Z_N", "tau_K_N_m", "tau_M_N_m", "tau_N_N_m"]
    keys = {
        "segment": [name] * t.size * 2,
        "model": ["linear"] * t.size + ["fossen"] * t.size,
        "t_s": np.tile(t, 2),
    }
    forces = {
        column: np.concatenate([4 * truth[:, index], 4 * np.roll(truth[:, index], 2)])
        for index, column in enumerate(columns)
    }
    return make_table("predictions", {**keys, **forces})


def _add_campaign(run: ExampleRun) -> None:
    coefficients = [
        [axis, item.term, item.value, item.standard_error, item.verdict]
        for axis, fit in run.cards["linear"].axes.items()
        for item in fit.terms
    ]
    blocks = [
        equation(
            r"\tau_\nu = K\,\xi(\nu), \qquad X = X_u u + X_{u|u|}\,u|u| + \frac{1}{2}\rho A C_D"
            r" \left(u - u_c\right)^2"
        ),
        table(
            "Coefficients of Linear",
            ["axis", "term", "value", ("standard error", ""), "verdict"],
            coefficients,
        ),
    ]
    run.sections["synthesise"] = section(
        "Models and coefficients",
        blocks,
        order=50,
        look_for="Which coefficients the data determine.",
    )
    heads = ["model", "n", "J", "J/J0", *AXES]
    rows: list[list[Any]] = [
        [title, terms, 4 * total, total, *(total * (1 + 0.1 * index) for index in range(6))]
        for title, terms, total in MODELS.values()
    ]
    t, truth, noisy = _signals(
        run.segments["check"].duration_s if "check" in run.segments else 20.0,
        np.random.default_rng(1),
    )
    t += run.segments["check"].leg_start_s if "check" in run.segments else 0.0
    panels = [
        panel(
            axis,
            unit,
            [series("measured", t, 4 * noisy[:, index], "measured")]
            + [
                series(title, t, 4 * np.roll(truth[:, index], 2 * place), name)
                for place, (name, (title, _, _)) in enumerate(MODELS.items())
            ],
        )
        for index, (axis, unit) in enumerate(zip(AXES, UNITS, strict=True))
    ]
    blocks = [
        table("Validation, layout of McCarter Table 5.1", heads, rows),
        plot("check", panels, group="time"),
    ]
    run.sections["validate"] = section("Errors and predictions", blocks, order=60)
    run.views["validate"] = {
        "groups": [
            {
                "entity": f"residual/X/{model}",
                "table": f"predictions/{name}",
                "columns": ["tau_X_N"],
                "names": [f"X {model}"],
            }
            | {"roles": [model], "tab": "Answer", "unit": "N", "filter": {"model": model}}
            for name in run.segments
            for model in ("linear", "fossen")
        ]
    }
