"""Exported files against their model: forces, terminal speeds, decays, losses, mistakes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.export import write
from auvid.pipeline.store.model_files import read_model, write_model
from tests.support.targets import mss
from tests.support.targets.conformance import decay, deviation, loss, printed_loss, terminal_speed
from tests.support.targets.exported import (
    EXACT,
    IMPOSSIBLE,
    LOADERS,
    LOSS_FLOOR,
    LOSS_SHARE,
    LOSSLESS,
    NAME,
    NEUTRAL,
    UPRIGHT,
    body_of,
    carrier,
    faults,
)
from tests.support.targets.frames import readme_of
from tests.support.targets.mistakes import MISTAKES
from tests.support.targets.models import MODELS, states
from tests.support.targets.reference import reference

THRUSTS = (0.5, 1.0, 2.0)
PAIRS = [(target, name) for target, names in LOSSLESS.items() for name in names]
LOSSY = [(target, name) for target in LOSSLESS for name in MODELS if name not in LOSSLESS[target]]


@pytest.fixture(autouse=True)
def _simulators(request: pytest.FixtureRequest) -> None:
    """Skip, with words, a target whose simulator is not installed here."""
    target = request.node.callspec.params.get("target") if hasattr(request.node, "callspec") else ""
    if target == "mss" and mss.OCTAVE is None:
        pytest.skip("GNU Octave (octave-cli) is not installed")
    if target == "mujoco":
        pytest.importorskip("mujoco", reason="MuJoCo is not installed")


def slow(*values: str, where: bool) -> Any:
    """A case that only a release needs: Octave starts anew, Stonefish sums over a box."""
    return pytest.param(*values, marks=pytest.mark.release if where else ())


@pytest.mark.parametrize(
    ("target", "name"),
    [slow(*pair, where=pair[0] == "mss" and pair[1] != "full") for pair in PAIRS],
)
def test_forces_at_hundreds_of_states_are_those_of_the_model(
    target: str, name: str, tmp_path: Path
) -> None:
    model = MODELS[name]()
    body = body_of(model, target, tmp_path)
    force, inertia = deviation(body, reference(model), *states(200))
    assert force < EXACT
    assert inertia < EXACT


@pytest.mark.parametrize("target", [target for target in LOSSLESS if LOSSLESS[target]])
def test_terminal_speeds_are_those_of_the_model(target: str, tmp_path: Path) -> None:
    """Six axes and three thrusts, within 0.1 %."""
    model = MODELS[LOSSLESS[target][-1]]()
    body, truth = body_of(model, target, tmp_path), reference(model)
    for axis in range(6):
        for thrust in np.array(THRUSTS) * (20.0 if axis < 3 else 0.5):
            right = terminal_speed(truth, axis, thrust)
            assert terminal_speed(body, axis, thrust) == pytest.approx(right, rel=1e-3)


@pytest.mark.parametrize("target", [target for target in LOSSLESS if LOSSLESS[target]])
def test_a_free_decay_is_that_of_the_model(target: str, tmp_path: Path) -> None:
    """Four seconds from moving, rolled and pitched; shares of the start's size."""
    model = MODELS[LOSSLESS[target][-1]]()
    nu, angles = np.array([0.5, 0.2, -0.2, 0.3, -0.2, 0.3]), np.array([0.2, -0.3, 0.4])
    here = decay(body_of(model, target, tmp_path), nu, angles)
    np.testing.assert_allclose(here, decay(reference(model), nu, angles), atol=1e-8)


@pytest.mark.parametrize(
    ("target", "name"),
    [slow(*pair, where=pair[0] == "stonefish" and pair[1] != "symmetric") for pair in LOSSY],
)
def test_what_a_target_cannot_hold_is_refused_and_its_loss_is_right(
    target: str, name: str, tmp_path: Path
) -> None:
    model = MODELS[name]()
    with pytest.raises(DataError, match="lossy"):
        write(model, target, tmp_path, name=NAME)
    upright = UPRIGHT.get(target, (2,))
    body = body_of(model, target, tmp_path)
    right = loss(body, model, neutral=target in NEUTRAL, upright=upright)
    printed = printed_loss(readme_of(tmp_path))
    np.testing.assert_allclose(printed, right, rtol=LOSS_SHARE, atol=LOSS_FLOOR)
    assert right.max() > 0.01


@pytest.mark.parametrize(
    "target", [slow(target, where=target in ("stonefish", "mss")) for target in LOADERS]
)
def test_twelve_planted_mistakes_show(target: str, tmp_path: Path) -> None:
    model = MODELS[carrier(target)]()
    assert faults(model, model, target, tmp_path) == []
    noticed = [name for name, f in MISTAKES.items() if faults(model, f(model), target, tmp_path)]
    assert noticed == [name for name in MISTAKES if name not in IMPOSSIBLE.get(target, ())]


def test_json_and_python_come_back_bit_for_bit(tmp_path: Path) -> None:
    """The json target is the model file; python computes with the model's own numbers."""
    model = MODELS["full"]()
    write_model(model, tmp_path / "model.json")
    write(model, "json", tmp_path / "json", name=NAME)
    again = read_model(tmp_path / "json" / f"{NAME}.json")
    write_model(again, tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "model.json").read_bytes()
    for folder, source in (("one", model), ("two", again)):
        write(source, "python", tmp_path / folder, name=NAME)
    code = [(tmp_path / folder / f"{NAME}.py").read_text() for folder in ("one", "two")]
    assert code[0] == code[1]
    namespace: dict[str, object] = {"__name__": NAME}
    exec(code[0], namespace)
    d = model.dynamics
    assert np.array_equal(namespace["MASS"], d.mass)  # type: ignore[arg-type]
    assert np.array_equal(namespace["ADDED_MASS"], d.added_mass)  # type: ignore[arg-type]
    numbers = {repr(entry.predictor) for entry in model.coefficients}
    assert all(number in code[0] for number in numbers)
