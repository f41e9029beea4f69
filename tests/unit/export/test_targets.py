"""Each target's numbers give auvid's own forces, or the loss that is printed."""

from __future__ import annotations

import importlib.util
import json
import math
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from auvid.data_schemas.records.model_file import ModelFile
from auvid.data_schemas.records.models import InertiaCard, UsableFor
from auvid.export import prepare, write
from auvid.export.body import Body, body_of, floated, floated_words
from auvid.export.losses import sample_envelope
from auvid.export.targets.gazebo import _holds
from auvid.export.targets.holoocean import Torpedo
from auvid.export.targets.stonefish import box_faces, drag_columns
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.actuators.thrusters import thruster_forces
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.mechanics.restoring import restoring_force
from auvid.hydro.model_file import forces
from auvid.pipeline.store.model_files import read_model
from tests.support.model_files import DAMPED, every_term, model_file
from tests.support.motions import shipped_vehicle
from tests.support.targets import gazebo, holoocean, mss, pvs, python, sitl, uuv
from tests.support.targets.conformance import moved

OFF_CENTRE = {
    "centre_of_gravity": {"value": [0.05, -0.02, 0.03], "unit": "m", "source": "this test"},
    "centre_of_buoyancy": {"value": [0.01, 0.02, -0.05], "unit": "m", "source": "this test"},
    "inertia": {
        "value": [[0.5, 0.02, -0.03], [0.02, 0.6, 0.01], [-0.03, 0.01, 0.7]],
        "unit": "kg*m^2",
        "source": "this test",
    },
}
"""A body whose centres lie off the origin on all axes, with products of inertia."""
COUNT = 200


def motion() -> tuple[Array, Array]:
    random = np.random.default_rng(5)
    return random.uniform(-1, 1, (COUNT, 6)), random.uniform(-1.2, 1.2, (COUNT, 6))


def right_side(model: ModelFile, nu: Array, eta: Array) -> Array:
    parts = forces(model, nu, eta)
    return np.asarray(parts.viscous + parts.restoring - parts.coriolis)


def loaded(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["python", "pvs", "mss"])
def test_targets_of_code_hold_every_term(name: str, tmp_path: Path) -> None:
    evaluator = {"python": python, "pvs": pvs, "mss": mss}[name]
    if evaluator is mss and mss.OCTAVE is None:
        pytest.skip("no Octave here")
    model = model_file(every_term(), moved=OFF_CENTRE)
    write(model, name, tmp_path, name="rov")
    body = evaluator.load(tmp_path, "rov")
    nu, eta = motion()
    expected = right_side(model, nu, eta)
    assert np.abs(body.force(nu, eta) - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(body.inertia - model.dynamics.mass).max() < 1e-9


def test_python_has_eta_and_actuators(tmp_path: Path) -> None:
    model = model_file(every_term(propeller=True), vehicle="vt690")
    (path, _) = write(model, "python", tmp_path, name="glider")
    module = loaded(path)
    nu, eta = motion()
    speeds = np.linspace(6.0, 20.0, COUNT)
    screw = model.dynamics.propeller
    assert screw is not None
    speeds = np.clip(speeds, screw.level_speed_rev_s[0], screw.level_speed_rev_s[-1])
    parts = forces(model, nu, eta, speeds)
    ours = [module.viscous(v, n) for v, n in zip(nu, speeds, strict=True)]
    assert np.abs(np.array(ours) - parts.viscous).max() < 1e-9 * np.abs(parts.viscous).max()
    assert module.propeller_force(nu[0], speeds[0])[0] != 0.0
    assert len(module.fin_force(nu[0], [0.1, 0.0, 0.0, 0.0])) == 6


def test_python_and_mss_give_no_number_outside_the_propeller_table(tmp_path: Path) -> None:
    """As auvid itself: an end of the table held on would be another model."""
    model = model_file(every_term(propeller=True), vehicle="vt690")
    screw = model.dynamics.propeller
    assert screw is not None
    nu, beyond = np.array([1.0, 0.2, 0, 0, 0, 0]), 1.01 * screw.level_speed_rev_s[-1]
    expected = forces(model, nu[None], np.zeros((1, 6)), np.array([beyond])).viscous[0]
    assert np.isnan(expected[0])
    write(model, "python", tmp_path, name="glider")
    ours = loaded(tmp_path / "glider.py").viscous(nu, beyond)
    assert ours == pytest.approx(expected, nan_ok=True)
    if mss.OCTAVE is None:
        pytest.skip("no Octave here")
    code = prepare(model, "mss", name="glider").files["glider.m"]
    (tmp_path / "glider.m").write_text(code, encoding="utf-8")
    state = f"[{' '.join(map(str, nu))} 0 0 0 0 0 0]'"
    call = f"[~, tau] = glider({state}, zeros(6, 1), {beyond});"
    words = [mss.OCTAVE, "--quiet", "--no-gui", "--no-init-file", "--eval"]
    words.append(f"addpath('{tmp_path}'); {call} printf('%d', isnan(tau(1)))")
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert done.stdout == "1"


@pytest.mark.parametrize("target", ["gazebo", "uuv", "stonefish"])
def test_thrusters_of_unknown_place_are_noted(target: str) -> None:
    """Without any in the file the README has no word on how to command them."""
    model = model_file()
    every = model.dynamics.thrusters
    none = [item.model_copy(update={"position_m": None}) for item in every]
    pages = {}
    for name, some in (("all", every), ("one", [none[0], *every[1:]]), ("none", none)):
        figures = model.dynamics.model_copy(update={"thrusters": some})
        changed = model.model_copy(update={"dynamics": figures})
        pages[name] = prepare(changed, target, name="rov", lossy=True).files[
            f"README_rov_{target}.md"
        ]
    noted = {name: "position is not known" in page for name, page in pages.items()}
    assert noted == {"all": False, "one": True, "none": True}
    used = {name: "Thruster i" in page for name, page in pages.items()}
    assert used == {"all": True, "one": True, "none": False}


def test_thrust_of_python_is_that_of_auvid(tmp_path: Path) -> None:
    (path, _) = write(model_file(), "python", tmp_path, name="rov")
    module, thrusters = loaded(path), shipped_vehicle("bluerov2_heavy").thrusters
    assert thrusters is not None
    for pulse in (0.0, 1000.0, 1101.0, 1469.0, 1500.0, 1533.0, 1777.0, 1950.0):
        expected = thruster_forces(thrusters, np.full(8, pulse), np.array(14.8))
        ours = [module.thrust(pulse, i, 14.8) for i in range(8)]
        assert ours == pytest.approx(expected, abs=1e-9)


def test_gazebo_holds_products_and_moduli_in_full(tmp_path: Path) -> None:
    model = model_file(every_term(), moved=OFF_CENTRE)
    kept = model.model_copy(
        update={
            "coefficients": [
                item
                for item, term in zip(model.coefficients, body_of(model).terms, strict=True)
                if _holds(term)
            ]
        }
    )
    assert len(kept.coefficients) == 6 * (6 + 21 + 36)
    write(kept, "gazebo", tmp_path, name="rov")
    body = gazebo.load(tmp_path, "rov")
    nu, eta = motion()
    expected = right_side(kept, nu, eta)
    assert np.abs(body.force(nu, eta) - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(body.inertia - kept.dynamics.mass).max() < 1e-9


def test_gazebo_damps_without_plain_squares(tmp_path: Path) -> None:
    text = prepare(model_file(DAMPED), "gazebo", name="rov").files["rov.sdf"]
    assert "<xUabsU>-20.0</xUabsU>" in text
    assert "<xUU>" not in text


def test_uuv_holds_full_linear_damping_about_the_centre_of_gravity(tmp_path: Path) -> None:
    """Seen from the link, which lies at its centre of gravity; its world has 9.8 m/s^2.

    Links of thrusters count: they have a mass, and base_link has so much less.
    """
    random = np.random.default_rng(8)
    terms = {axis: {speed: float(random.normal()) for speed in "uvwpqr"} for axis in AXES}
    model = with_gravity(model_file(terms, moved=OFF_CENTRE), uuv.WORLD_GRAVITY)
    write(model, "uuv", tmp_path, name="rov")
    body = uuv.load(tmp_path, "rov")
    nu, eta = motion()
    arm = uuv.origin(tmp_path)
    move = np.eye(6)
    move[:3, 3:] = [[0, arm[2], -arm[1]], [-arm[2], 0, arm[0]], [arm[1], -arm[0], 0]]
    at_G = nu @ move.T  # v_G = v + omega x r_G
    ours = body.force(at_G, eta) @ move
    expected = right_side(model, nu, eta)
    assert np.abs(ours - expected).max() < 1e-9 * np.abs(expected).max()
    assert np.abs(move.T @ body.inertia @ move - model.dynamics.mass).max() < 1e-9


def with_gravity(model: ModelFile, gravity: float) -> ModelFile:
    share = gravity / model.dynamics.gravity_m_s2
    figures = model.dynamics.model_copy(
        update={
            "gravity_m_s2": gravity,
            "weight_N": model.dynamics.weight_N * share,
            "buoyancy_N": model.dynamics.buoyancy_N * share,
        }
    )
    return model.model_copy(update={"dynamics": figures})


@pytest.mark.parametrize("name", ["gazebo", "uuv"])
def test_printed_loss_is_the_error_of_the_forces(name: str, tmp_path: Path) -> None:
    """Over the flown range, by an evaluator that knows the target alone."""
    model = with_gravity(model_file(every_term()), 9.8)
    write(model, name, tmp_path, name="rov", lossy=True)
    losses = prepare(model, name, name="rov", lossy=True).losses
    body = {"gazebo": gazebo, "uuv": uuv}[name].load(tmp_path, "rov")
    if name == "uuv":
        body = moved(body, uuv.origin(tmp_path))
    nu, _ = sample_envelope(model.validity)
    eta = np.zeros_like(nu)
    error = right_side(model, nu, eta) - body.force(nu, eta)
    assert np.sqrt(np.mean(error**2, axis=0)) == pytest.approx(losses.total_rms, rel=1e-9)
    assert min(losses.total_rms) > 1.0


def test_sitl_loses_what_its_simulator_lacks(tmp_path: Path) -> None:
    """Level, where restoring forces vanish: the difference of forces is that of the rows."""
    model = model_file(DAMPED)
    write(model, "sitl", tmp_path, name="rov", lossy=True)
    body = sitl.load(tmp_path, "rov")
    nu, _ = sample_envelope(model.validity)
    error = right_side(model, nu, 0 * nu) - body.force(nu, 0 * nu)
    assert np.diag(body.inertia)[:3] == pytest.approx(
        np.full(3, np.mean(np.diag(model.dynamics.mass)[:3]))
    )
    drag, turning = prepare(model, "sitl", name="rov", lossy=True).losses.rows
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < np.array(drag.rms) + turning.rms + 1e-9)


def test_sitl_net_buoyancy_has_the_fitted_heave_force(tmp_path: Path) -> None:
    model = model_file({**DAMPED, "Z": {"w": -5.0, "constant": -2.0}})
    text = prepare(model, "sitl", name="rov", lossy=True).files["rov.parm"]
    assert float(text.split("SIM_BUOYANCY,")[1]) == pytest.approx(2.0, abs=1e-9)


def test_mujoco_accelerates_as_auvid(tmp_path: Path) -> None:
    """With thrust and applied forces, on a body with centres off its origin."""
    mujoco = pytest.importorskip("mujoco")
    model = model_file(every_term(), moved=OFF_CENTRE)
    xml, script, _ = write(model, "mujoco", tmp_path, name="rov")
    simulation = mujoco.MjModel.from_xml_path(str(xml))
    data = mujoco.MjData(simulation)
    module = loaded(script)
    module.install()
    flip, turn = np.diag([1.0, -1.0, -1.0]), np.array([1.0, -1, -1, 1, -1, -1])
    random = np.random.default_rng(2)
    effects = np.array([item.effect for item in model.dynamics.thrusters])
    try:
        for nu, eta in zip(*(part[:20] for part in motion()), strict=True):
            rotation = flip @ rotation_body_to_ned(eta[3:]) @ flip
            mujoco.mju_mat2Quat(data.qpos[3:], rotation.ravel())
            flu = turn * nu
            data.qvel[:] = np.hstack([rotation @ flu[:3], flu[3:]])
            data.ctrl[:] = random.uniform(-9, 9, 8)
            push = random.uniform(-5, 5, 6)
            data.xfrc_applied[simulation.body("rov").id] = push
            mujoco.mj_forward(simulation, data)
            in_body = rotation.T @ data.qacc[:3] - np.cross(flu[3:], flu[:3])
            ours = turn * np.hstack([in_body, data.qacc[3:]])
            force, arm = rotation.T @ push[:3], flip @ model.dynamics.centre_of_gravity_m
            moment = rotation.T @ push[3:] + np.cross(arm, force)
            tau = data.ctrl @ effects + turn * np.hstack([force, moment])
            total = right_side(model, nu[None], eta[None])[0] + tau
            expected = np.linalg.solve(model.dynamics.mass, total)
            assert ours == pytest.approx(expected, rel=1e-9, abs=1e-9)
    finally:
        mujoco.set_mjcb_passive(None)


def test_faces_of_the_box_close() -> None:
    middles, normals, areas = box_faces(np.array([0.4, 0.3, 0.2]))
    assert len(areas) == 12 * 4**3
    assert areas.sum() == pytest.approx(2 * (0.12 + 0.08 + 0.06))
    assert np.abs(normals.T @ areas).max() < 1e-12
    volume = np.sum(np.sum(middles * normals, axis=1) * areas) / 3.0
    assert volume == pytest.approx(0.024)


def test_stonefish_drags_the_front_face_with_the_cube_of_the_speed() -> None:
    """Its source has three factors of the velocity; friction acts on the four sides."""
    body = body_of(model_file())
    a, b, c = body.box
    columns = drag_columns(body, np.array([[0.5, 0, 0, 0, 0, 0]]))[0]
    area = b * c
    assert columns[0, 3] == pytest.approx(-0.5 * body.water_density * area * 0.125)
    assert columns[0, 0] == pytest.approx(-body.water_density * 2 * a * (b + c) * 0.5)
    assert columns[:3, [1, 2, 4, 5]] == pytest.approx(0.0, abs=1e-9)


def test_stonefish_fit_is_no_worse_than_no_drag() -> None:
    losses = prepare(model_file(), "stonefish", name="rov", lossy=True).losses
    fit = losses.rows[0]
    assert sum(np.array(fit.rms) ** 2 / np.array(losses.viscous_rms) ** 2) < 6.0


def test_holoocean_torpedo_is_that_of_its_client(tmp_path: Path) -> None:
    """Without heave, where the span that the client gives the hull does not count."""
    write(model_file(vehicle="remus100"), "holoocean", tmp_path, name="auv", lossy=True)
    agent = json.loads((tmp_path / "auv.json").read_text(encoding="utf-8"))
    figures = agent["dynamics"]
    torpedo = Torpedo(
        figures["length"],
        figures["diam"],
        figures["mass"],
        np.array(figures["r_bg"]),
        np.array(figures["r_bb"]),
    )
    drag = figures["Cd"] * math.pi * (torpedo.diameter / 2.0) ** 2 / torpedo.area
    factors = np.array(
        [
            1.0 / figures["T_surge"],
            1.0 / figures["T_sway"],
            figures["zeta_roll"],
            figures["zeta_pitch"],
            1.0 / figures["T_yaw"],
            drag,
            1.0 / figures["e"],
        ]
    )
    body = holoocean.load(tmp_path, "auv")
    nu = np.abs(motion()[0]) * [1, 1, 0, 1, 1, -1]
    ours = torpedo.fixed_force(nu) + torpedo.columns(nu) @ factors - torpedo.coriolis(nu)
    level = np.zeros_like(nu)
    theirs = body.force(nu, level) - body.force(0 * nu, level)
    assert np.abs(ours - theirs)[:, 1:].max() < 1e-9 * np.abs(theirs).max()
    assert np.abs(body.inertia - torpedo.rigid_body - torpedo.added_mass).max() < 1e-9


def test_holoocean_fits_what_the_torpedo_has_alone() -> None:
    """Roll and pitch damping come from nowhere else: the fit has them in full."""
    use = UsableFor(forces=["K", "M"], simulation=[], control=[], speeds={})
    model = model_file({"K": {"p": -0.4}, "M": {"q": -7.0}}, vehicle="remus100", use=use)
    fit = prepare(model, "holoocean", name="auv", lossy=True).losses.rows[0]
    assert fit.rms[3:5] == pytest.approx((0.0, 0.0), abs=1e-9)


def test_draws_are_passive_and_moved_ones_counted() -> None:
    """Of two axes with errors as large as their damping 29 % have a wrong sign."""
    model = model_file({"X": {"u": -4.0}, "Y": {"v": -1.0}}, error=1.0)
    prepared = prepare(model, "draws", name="rov", draws=1000)
    header, first, *rows = prepared.files["rov_draws.csv"].split()
    assert header == "draw,X_u,Y_v"
    assert first == "0,-4.0,-1.0"
    values = np.array([[float(x) for x in row.split(",")[1:]] for row in rows])
    assert values.shape == (1000, 2)
    assert values.max() <= 1e-9
    share = 1.0 - (0.5 * (1.0 + math.erf(1.0 / math.sqrt(2.0)))) ** 2
    moved = int(prepared.losses.notes[0].split()[4])
    assert moved / 1000 == pytest.approx(share, abs=0.05)


def test_no_draw_has_an_inertia_that_no_body_has() -> None:
    """Half of the normal draws of a yaw added mass of 0 +- 1 kg m2 lie above 0."""
    inertia = InertiaCard.model_construct(name="N_rdot", change=0.0, standard_error=1.0)
    model = model_file({"N": {"r": -2.0}}, error=0.01)
    model.dynamics.added_mass[5][5] = 0.0
    fitted = model.model_copy(update={"fitted_inertia": [inertia]})
    prepared = prepare(fitted, "draws", name="rov", draws=40)
    header, _, *rows = prepared.files["rov_draws.csv"].split()
    assert header.endswith("N_rdot")
    values = [float(row.split(",")[-1]) for row in rows]
    assert max(values) <= 1e-9
    assert min(values) < -0.5
    assert "an inertia that no body has" in prepared.losses.notes[0]


def test_draws_are_those_of_the_bands_of_validation() -> None:
    """The same limits: a threshold of excitation on the card widens no range."""
    model = model_file({"Y": {"v": -4.0, "u*v": 3.0}}, error=0.5)
    wide = {k: v.model_copy(update={"threshold": 5.0}) for k, v in model.validity.items()}
    wider = model.model_copy(update={"validity": wide})
    ours, theirs = (
        prepare(m, "draws", name="rov", draws=50).files["rov_draws.csv"] for m in (model, wider)
    )
    assert ours == theirs
    assert "is drawn once for all axes" in str(
        prepare(model, "draws", name="rov", draws=3).losses.notes
    )


def test_json_is_the_model_file(tmp_path: Path) -> None:
    model = model_file()
    (path, _) = write(model, "json", tmp_path)
    assert read_model(path).model_dump() == model.sealed().model_dump()


def test_code_of_python_imports_math_alone(tmp_path: Path) -> None:
    (path, _) = write(model_file(), "python", tmp_path, name="rov")
    lines = path.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if line.startswith(("import", "from"))] == ["import math"]
    assert "rov" not in sys.modules


def test_constant_forces_in_the_buoyancy_are_the_models_where_it_is_level() -> None:
    """Whatever the heading; tilted the righting moment stays, and Z keeps to the vertical."""
    constants = {"X": 0.3, "Y": -0.2, "Z": -4.5, "K": 0.16, "M": -0.45, "N": 0.18}
    terms = {axis: {**DAMPED[axis], "constant": value} for axis, value in constants.items()}
    body = body_of(model_file(terms, moved=OFF_CENTRE))
    changed = floated(body)
    level = np.zeros((2, 6))
    level[1, 5] = 2.0
    extra = standing(changed, level) - standing(body, level)
    np.testing.assert_allclose(extra, [[0.0, 0.0, -4.5, 0.16, -0.45, 0.0]] * 2, atol=1e-12)
    assert [term.symbol for term in changed.terms if term.constant] == [
        "X_constant", "Y_constant", "N_constant",
    ]  # fmt: skip
    rolled = np.array([[0.0, 0.0, 0.0, 0.1, 0.0, 0.0]])
    extra = standing(changed, rolled) - standing(body, rolled)
    down = np.array([0.0, np.sin(0.1), np.cos(0.1)])
    expected = [*(-4.5 * down), 0.16 * np.cos(0.1), -0.45 * np.cos(0.1), 0.45 * np.sin(0.1)]
    np.testing.assert_allclose(extra[0], expected, atol=1e-12)
    words = floated_words(body)
    assert "Z -4.5 N, K 0.16 N m, M -0.45 N m" in words
    assert "at 10 degrees 0.78 N lie across" in words


def standing(body: Body, eta: Array) -> Array:
    return restoring_force(
        eta, weight=body.weight, buoyancy=body.buoyancy, r_G=body.r_G, r_B=body.r_B
    )


def test_no_buoyancy_is_made_negative() -> None:
    body = body_of(model_file({**DAMPED, "Z": {"w": -3.0, "constant": 1e4}}))
    assert floated(body) is body
    assert floated_words(body) == ""


@pytest.mark.parametrize(("target", "first", "axes"), [("gazebo", 1, "XY"), ("uuv", 0, "XYN")])
def test_thruster_forces_make_the_constants_that_are_lost(
    target: str, first: int, axes: str
) -> None:
    constants = {"X": 0.3, "Y": -0.2, "Z": -4.5, "N": 0.18}
    terms = {axis: {**DAMPED[axis], "constant": value} for axis, value in constants.items()}
    model = model_file(terms)
    prepared = prepare(model, target, name="rov", lossy=True)
    symbols = [f"{axis}_constant" for axis in axes]
    assert prepared.losses.rows[0].what.split(", ") == symbols
    page = prepared.files[f"README_rov_{target}.md"]
    listed = re.search(r"add to their forces, in N, (.*)\.\n", page)
    assert listed is not None
    offsets = dict(part.split(": ") for part in listed[1].split(", "))
    assert list(offsets) == [str(i + first) for i in range(8)]
    effects = np.array([item.effect for item in model.dynamics.thrusters])
    thrust = np.array([float(value) for value in offsets.values()]) @ effects
    expected = [constants[axis] if axis in axes else 0.0 for axis in AXES]
    np.testing.assert_allclose(thrust, expected, atol=2e-3)
