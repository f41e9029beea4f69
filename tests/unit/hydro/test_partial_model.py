"""Models that lack axes or have a unit of mass of their own, as files and in motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import auvid
from auvid.data_schemas.errors import DataError, PipelineError, SchemaError, UsageError
from auvid.export import TARGETS, prepare
from auvid.hydro.arrays import AXES
from auvid.hydro.model_file import forces, vehicle_of
from auvid.pipeline.store.model_files import read_model, write_model
from tests.support.model_files import DAMPED, model_file
from tests.support.partial_models import partial_file

TIME = np.arange(0.0, 20.0, 0.05)


@pytest.mark.parametrize("unit", [None, "Z", "N"])
def test_a_partial_file_reads_back_equal(unit: str | None, tmp_path: Path) -> None:
    file = partial_file(unit_of_mass=unit)
    write_model(file, tmp_path / "m.json")
    assert read_model(tmp_path / "m.json").model_dump_json() == file.sealed().model_dump_json()
    assert file.format == 2


def test_a_whole_file_keeps_format_1_and_says_nothing_of_parts(tmp_path: Path) -> None:
    file = model_file()
    write_model(file, tmp_path / "m.json")
    assert '"partial"' not in (tmp_path / "m.json").read_text()
    assert read_model(tmp_path / "m.json").format == 1
    wrong = partial_file().model_copy(update={"format": 1}).model_dump_json(exclude_unset=True)
    (tmp_path / "p.json").write_text(wrong)
    with pytest.raises(PipelineError, match="has format 2"):
        read_model(tmp_path / "p.json")


def test_a_format_of_the_future_is_refused(tmp_path: Path) -> None:
    text = model_file().model_copy(update={"format": 3}).model_dump_json(exclude_unset=True)
    (tmp_path / "m.json").write_text(text)
    with pytest.raises(SchemaError, match="install that version, or a newer one"):
        read_model(tmp_path / "m.json")


def test_axes_that_are_lacking_have_no_force() -> None:
    parts = forces(partial_file(), np.full((2, 6), 0.1), np.zeros((2, 6)))
    for part in vars(parts).values():
        assert np.isnan(part[:, [AXES.index(axis) for axis in "XYKM"]]).all()
        assert np.isfinite(part[:, [AXES.index(axis) for axis in "ZN"]]).all()


def test_the_apparent_inertia_of_the_axis_is_1() -> None:
    mass = vehicle_of(partial_file(unit_of_mass="Z")).mass_matrix
    total = vehicle_of(model_file()).mass_matrix
    assert mass[2, 2] == pytest.approx(1.0)
    np.testing.assert_allclose(mass, total / total[2, 2])


def test_heave_and_yaw_move_as_their_equations_say_and_the_rest_stays() -> None:
    """x' = (F + d |x| x + a x) / m in steps of 5 ms, with the lag of 0.1 s."""
    model = auvid.Model(partial_file())
    pull = {"Z": 12.0, "N": 1.5}
    tau = np.zeros((len(TIME), 6))
    tau[len(TIME) // 4 :, [2, 5]] = list(pull.values())
    tau[:, 0] = 50.0  # on an axis that the model lacks: nothing moves by it
    motion = model.simulate(TIME, tau, eta=[0, 0, 5, 0, 0, 0])
    assert motion.attrs["held"] == ["u_m_s", "v_m_s", "p_rad_s", "q_rad_s", "phi_rad", "theta_rad"]
    assert np.all(motion[motion.attrs["held"]] == 0.0)
    vehicle = model.vehicle
    for axis, column in (("Z", "w_m_s"), ("N", "r_rad_s")):
        place = AXES.index(axis)
        linear, quadratic = DAMPED[axis].values()
        net = vehicle.weight - vehicle.buoyancy if axis == "Z" else 0.0
        speed, late, step = 0.0, 0.0, 0.005
        for t in np.arange(0.0, TIME[-1] - step / 2, step):
            late += step / 0.1 * (np.interp(t, TIME, tau[:, place]) - late)
            drag = linear * speed + quadratic * abs(speed) * speed
            speed += step * (late + net + drag) / vehicle.mass_matrix[place, place]
        assert motion[column].iloc[-1] == pytest.approx(speed, rel=5e-3)


def test_a_unit_of_mass_changes_no_motion() -> None:
    """The same thrusts as full commands of 40 N and as newtons."""
    full, share = auvid.Model(partial_file()), auvid.Model(partial_file(unit_of_mass="Z"))
    command = np.where(TIME > 5.0, 0.3, 0.0)
    tau = np.zeros((len(TIME), 6))
    tau[:, 2], tau[:, 5] = 40.0 * command, -40.0 * 0.1 * command
    one = full.simulate(TIME, tau)
    other = share.simulate(TIME, commands={"Z": command, "N": -0.1 * command})
    np.testing.assert_allclose(one, other, atol=1e-9)
    assert np.ptp(one["w_m_s"]) > 0.1


def test_commands_need_a_gain() -> None:
    with pytest.raises(UsageError, match="no gain for a command"):
        auvid.Model(partial_file()).simulate(TIME, commands={"Z": 1.0})
    with pytest.raises(UsageError, match="force of the actuators or their commands"):
        auvid.Model(partial_file(unit_of_mass="Z")).simulate(TIME, np.zeros(6), commands={"Z": 1.0})


HOLDING = {"python", "json", "draws"}


@pytest.mark.parametrize("target", sorted(set(TARGETS) - HOLDING))
def test_targets_of_six_axes_name_those_that_are_lacking(target: str) -> None:
    with pytest.raises(DataError) as refused:
        prepare(partial_file(), target, lossy=True)
    words = str(refused.value)
    assert "surge (not observable)" in words
    assert "fill: {surge:" in words
    assert "Log a velocity (DVL)." in words


@pytest.mark.parametrize("target", sorted(set(TARGETS) - HOLDING))
def test_targets_in_newtons_refuse_a_model_without(target: str) -> None:
    with pytest.raises(DataError, match="full_force"):
        prepare(partial_file(tuple(AXES), "X"), target, lossy=True)


@pytest.mark.parametrize("unit", [None, "Z"])
@pytest.mark.parametrize("target", sorted(HOLDING))
def test_targets_that_hold_parts_say_so(target: str, unit: str | None) -> None:
    prepared = prepare(partial_file(unit_of_mass=unit), target, name="rov", draws=3)
    texts = "".join(prepared.files.values())
    if target == "python":
        assert "It lacks surge, not observable" in texts
        assert ("NO NEWTONS" in texts) == (unit is not None)
        assert ("[kg" in prepared.files["rov.py"]) == (unit is None)


@pytest.mark.parametrize("unit", [None, "Z"])
def test_the_python_file_computes_what_the_model_does(unit: str | None) -> None:
    """Accelerations of the axes that it has; those that it lacks have none, and no force."""
    file = partial_file(unit_of_mass=unit)
    scope: dict[str, object] = {}
    exec(prepare(file, "python", name="rov").files["rov.py"], scope)
    scale = vehicle_of(file).mass_matrix[2, 2] / vehicle_of(model_file()).mass_matrix[2, 2]
    tau = [scale * value for value in (50.0, 0.0, 12.0, 0.0, 0.0, 1.5)]
    rates = scope["derivative"]([0, 0, 0.2, 0, 0, 0.3], [0] * 6, tau)  # type: ignore[operator]
    vehicle = vehicle_of(model_file())
    for axis, speed, force in (("Z", 0.2, 12.0), ("N", 0.3, 1.5)):
        place = AXES.index(axis)
        linear, quadratic = DAMPED[axis].values()
        total = force + linear * speed + quadratic * speed**2
        total += vehicle.weight - vehicle.buoyancy if axis == "Z" else 0.0
        assert rates[place] == pytest.approx(total / vehicle.mass_matrix[place, place], rel=1e-9)
    assert [rates[AXES.index(axis)] for axis in "XYKM"] == [0.0] * 4
    for name, arguments in (("viscous", ([1.0] * 6,)), ("force", ([1.0] * 6, [0.0] * 6))):
        parts = np.array(scope[name](*arguments))  # type: ignore[operator]
        np.testing.assert_array_equal(np.isfinite(parts), [axis in "ZN" for axis in AXES])
    if unit is not None:
        pull = scope["command_force"]({"Z": 0.5})  # type: ignore[operator]
        assert pull[2] == pytest.approx(20.0 * scale)


def test_newtons_on_a_model_without_newtons_are_refused() -> None:
    model = auvid.Model(partial_file(unit_of_mass="Z"))
    with pytest.raises(UsageError, match=r"no newtons.*inertia of Z.*Give commands"):
        model.simulate(TIME, [0, 0, 20.0, 0, 0, 0])
    assert model.simulate(TIME, np.zeros(6))["w_m_s"].notna().all()
