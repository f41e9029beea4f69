"""What is refused, what files say, and which names they take."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from auvid.data_schemas.errors import DataError, PipelineError, UsageError
from auvid.data_schemas.records.models import UsableFor
from auvid.export import TARGETS, check_target, prepare, write
from auvid.export.losses import sample_envelope
from auvid.export.text import identifier, number
from tests.support.model_files import DAMPED, NO_USE, model_file

FILES = {
    "gazebo": ["rov.sdf"],
    "uuv": ["rov.xacro"],
    "mss": ["rov.m"],
    "pvs": ["rov.py"],
    "holoocean": ["rov.json"],
    "stonefish": ["rov.scn"],
    "mujoco": ["rov.xml", "rov_forces.py"],
    "sitl": ["rov.parm", "rov.md"],
    "python": ["rov.py"],
    "json": ["rov.json"],
    "draws": ["rov_draws.csv"],
}


@pytest.mark.parametrize("target", sorted(TARGETS))
def test_files_have_their_names_and_a_readme(target: str, tmp_path: Path) -> None:
    paths = write(model_file(), target, tmp_path, name="rov", lossy=True, draws=5)
    assert [path.name for path in paths] == [*FILES[target], f"README_rov_{target}.md"]
    assert all(path.stat().st_size for path in paths)
    page = paths[-1].read_text(encoding="utf-8")
    assert "## Convention" in page
    assert "## How to use it" in page
    assert "- Use: Made up: use it" in page
    assert "flown range" in page.split("## Convention")[0]
    if target not in ("json", "draws"):
        head = paths[0].read_text(encoding="utf-8")
        assert "Made up: use it" in head
        assert "flown range" in head


@pytest.mark.parametrize(
    ("target", "vehicle"),
    [
        pytest.param(
            target,
            vehicle,
            # The drag of a box takes seconds: for one vehicle here, for all in a release.
            marks=pytest.mark.release if target == "stonefish" and vehicle != "hauv" else (),
        )
        for target in sorted(TARGETS)
        for vehicle in ("hauv", "remus100", "thaus", "vt690")
    ],
)
def test_every_vehicle_has_files_of_every_target(target: str, vehicle: str) -> None:
    """Those without thrusters, geometry or thruster positions too; no number is missing."""
    files = prepare(model_file(vehicle=vehicle), target, name="auv", lossy=True, draws=3).files
    for name, text in files.items():
        if name.endswith((".sdf", ".xacro", ".scn", ".xml")):
            ElementTree.fromstring(text)
        if not name.endswith(".md"):
            assert "nan" not in text.replace("\n", " ").split(" ")
    assert len(files) == len(FILES[target]) + 1


@pytest.mark.parametrize("target", sorted(TARGETS))
def test_no_title_leaves_its_comment(target: str) -> None:
    """Neither a line break that code follows nor hyphens that end a comment of XML."""
    model = model_file().model_copy(update={"title": 'A ---\nboom = 1 / 0;\n"""\\ --->'})
    files = prepare(model, target, name="rov", lossy=True, draws=3).files
    for name, text in files.items():
        if name.endswith((".sdf", ".xacro", ".scn", ".xml")):
            ElementTree.fromstring(text)
        if name.endswith(".py"):
            compile(text, name, "exec")
        assert not re.search(r"(?m)^boom", text)


def test_unknown_target_names_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"Did you mean 'gazebo'\?"):
        write(model_file(), "gazbo", tmp_path)


@pytest.mark.parametrize(
    ("name", "words"),
    [("simulink", "take the target mss"), ("ArduSub", "target sitl"), ("dave", "target uuv")],
)
def test_the_name_of_a_simulator_leads_to_its_target(name: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        check_target(name)


def test_targets_and_models_share_a_folder(tmp_path: Path) -> None:
    for target in ("gazebo", "mss"):
        for name in ("rov", "other"):
            write(model_file(), target, tmp_path, name=name)
    assert len(list(tmp_path.glob("README_*.md"))) == 4


def test_a_model_without_a_range_is_measured_over_one_metre_per_second() -> None:
    """As a published set; the words say so, and no flown range is claimed."""
    terms = {**DAMPED, "X": {"u": -6.0, "constant": 2.0}}
    model = model_file(terms).model_copy(update={"validity": {}})
    prepared = prepare(model, "gazebo", name="rov", lossy=True)
    nu, _ = sample_envelope({})
    assert -1.0 <= nu.min() < -0.99
    assert 0.99 < nu.max() <= 1.0
    # Evenly over -1 to 1 the mean square of u is a third.
    assert prepared.losses.viscous_rms[0] == pytest.approx((36.0 / 3.0 + 4.0) ** 0.5, rel=0.03)
    assert prepared.losses.rows[0].rms[0] == pytest.approx(2.0)
    assert (
        "up to 1 m/s and rad/s, for want of a flown range" in prepared.files["README_rov_gazebo.md"]
    )
    assert "within the flown range (m/s" not in prepared.files["rov.sdf"]


def test_a_model_without_covariance_has_no_draws() -> None:
    model = model_file().model_copy(update={"covariance": {}})
    with pytest.raises(DataError, match="no covariance to draw from"):
        prepare(model, "draws")


def test_a_file_is_not_overwritten_without_force(tmp_path: Path) -> None:
    model = model_file()
    (path, _) = write(model, "python", tmp_path, name="rov")
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(PipelineError, match="the file exists"):
        write(model, "python", tmp_path, name="rov")
    assert path.read_text(encoding="utf-8") == "mine"
    write(model, "python", tmp_path, name="rov", force=True)
    assert path.read_text(encoding="utf-8") != "mine"


def test_a_model_for_nothing_needs_force_and_says_so(tmp_path: Path) -> None:
    model = model_file(use=NO_USE)
    with pytest.raises(DataError, match="usable for nothing"):
        write(model, "python", tmp_path, name="rov")
    assert not list(tmp_path.iterdir())
    paths = write(model, "python", tmp_path, name="rov", force=True)
    assert all("USABLE FOR NOTHING" in path.read_text(encoding="utf-8").upper() for path in paths)


def test_a_model_that_nothing_judges_is_written_and_says_so(tmp_path: Path) -> None:
    paths = write(model_file(use=None), "python", tmp_path, name="rov")
    assert "no axis has a verdict" in paths[0].read_text(encoding="utf-8")


def test_losses_count_on_usable_axes_alone(tmp_path: Path) -> None:
    """A constant sway force does not matter where the model is usable for surge alone."""
    terms = {**DAMPED, "Y": {"v": -3.0, "constant": 0.5}}
    use = UsableFor(forces=["X"], simulation=[], control=[], speeds={})
    assert prepare(model_file(terms, use=use), "gazebo").losses.too_large == ()
    with pytest.raises(DataError, match="Y_constant"):
        write(model_file(terms), "gazebo", tmp_path)
    lossy = prepare(model_file(terms), "gazebo", lossy=True).losses
    assert lossy.too_large == ("Y",)
    assert lossy.rows[0].rms == pytest.approx((0, 0.5, 0, 0, 0, 0))


def test_a_small_loss_is_written_and_printed(tmp_path: Path) -> None:
    """0.005 N of 2.4 N are below 1 %."""
    terms = {**DAMPED, "X": {"u": -6.0, "constant": 0.005}}
    losses = prepare(model_file(terms), "uuv").losses
    assert 0.0 < losses.shares["X"] < 0.01


@pytest.mark.parametrize("name", ["2fast", "a-b", "", "class", "endfunction", "ü", "a" * 64])
def test_a_name_that_is_no_identifier_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match="Take for example") as caught:
        identifier(name)
    better = str(caught.value).rsplit(" ", 1)[1].rstrip(".")
    assert identifier(better) == better


def test_numbers_read_back_as_they_are() -> None:
    for value in (0.1, 1e-300, -1.0 / 3.0, 12345678.9012345):
        assert float(number(value)) == value
