"""Installed, auvid is one package, and each of its modules is loaded once."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections import Counter
from pathlib import Path

import pytest

import auvid
from tests.support.source_trees import statements, tree_of

ROOT = Path(__file__).resolve().parents[2]
FLOORS = ("data_schemas", "hydro", "stages", "export", "pipeline", "vehicles")
BUILD = "from setuptools import build_meta; print(build_meta.build_wheel({!r}))"
MAIN = "from auvid.pipeline.cli import main; main()"
COMMANDS = """
import auvid, auvid.stages, stages, pipeline, hydro
from auvid.pipeline.cli import app
from typer.testing import CliRunner
assert stages.MINE and pipeline.MINE and hydro.MINE
print(auvid.__file__, auvid.stages.__file__)
for words in ("--help", "vehicles"):
    done = CliRunner().invoke(app, [words], catch_exceptions=False)
    assert done.exit_code == 0, (words, done.output)
    print(done.output)
"""


INTERFACE = """
import time
import auvid
results = auvid.run("example", progress=False)
begin = time.process_time()
from pathlib import Path
import numpy as np
model = results.models["symmetric"]
again = auvid.Model.load(model.save("model.json"))
t = np.arange(0.0, 60.0, 0.05)
tau = 20.0 * np.sin(np.outer(t, np.arange(1, 7) * 0.3)) * [1, 1, 1, 0.05, 0.05, 0.1]
motion = again.simulate(t, tau)
fitted = auvid.fit(t, motion.iloc[:, 1:7], motion.iloc[:, 10:], again.vehicle, tau=tau)
assert fitted.coefficients.determined.any(), fitted.coefficients
assert np.isfinite(auvid.score(again, results)["J/J0"]).all()
assert again.export("python", "exported")
print(auvid.__file__, time.process_time() - begin)
"""
"""What a user does with an installed package; seconds of everything but the run."""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of packages that holds the wheel of auvid and nothing else."""
    folder = tmp_path_factory.mktemp("wheel")
    source, target = folder / "source", folder / "site"
    for name in ("auvid", *FLOORS):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    python("-c", BUILD.format(str(folder)), folder=source)
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel:
        wheel.extractall(target)
    return target


def python(*arguments: str, folder: Path, path: Path | None = None) -> str:
    environment = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(path or "")}
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_wheel_holds_one_package(site: Path) -> None:
    names = {path.name for path in site.iterdir() if path.suffix != ".dist-info"}
    assert names == {"auvid"}


def test_wheel_holds_every_file_of_the_package(site: Path) -> None:
    """What lies in a floor and is no cache, note or stub travels with it."""
    files = {path.relative_to(ROOT) for floor in FLOORS for path in (ROOT / floor).rglob("*.*")}
    expected = {
        path
        for path in files
        if (ROOT / path).is_file()
        and "__pycache__" not in path.parts
        and path.suffix not in (".md", ".pyc")
    }
    expected |= {path.relative_to(ROOT / "auvid") for path in (ROOT / "auvid").glob("*.py*")}
    installed = {path.relative_to(site / "auvid") for path in (site / "auvid").rglob("*")}
    assert sorted(map(str, expected - installed)) == []


def test_installed_commands_work_beside_files_of_its_names(site: Path, tmp_path: Path) -> None:
    """A stages.py beside a notebook neither harms the package nor is harmed."""
    assert python("-c", MAIN, "--version", folder=tmp_path, path=site) == (
        f"auvid {auvid.__version__}\n"
    )
    for floor in FLOORS:
        (tmp_path / f"{floor}.py").write_text("MINE = True\n")
    places, _, printed = python("-c", COMMANDS, folder=tmp_path, path=site).partition("\n")
    assert places.split() == [
        str(site / "auvid/__init__.py"),
        str(site / "auvid/stages/__init__.py"),
    ]
    assert "reproduce" in printed
    assert "vt690" in printed


@pytest.mark.release
def test_installed_package_makes_a_workspace(site: Path, tmp_path: Path) -> None:
    """Its example is simulated by loops that a fresh package compiles first."""
    python("-c", MAIN, "new", "workspace", folder=tmp_path, path=site)
    assert (tmp_path / "workspace/campaigns/example/logs").is_dir()


@pytest.mark.release
def test_installed_package_serves_python(site: Path, tmp_path: Path) -> None:
    """A run, then load, simulate, fit, score and export within 5 s of processor time."""
    python("-c", MAIN, "new", "workspace", folder=tmp_path, path=site)
    printed = python("-c", INTERFACE, folder=tmp_path / "workspace", path=site)
    place, seconds = printed.split()
    assert place == str(site / "auvid/__init__.py")
    assert float(seconds) < 5.0


EXPORT = """
import auvid
model = auvid.open_model("bluerov2_wu_2018")
model.save("rov.json")
"""
RESOURCES = "import resource; print(resource.getrusage(resource.RUSAGE_SELF).ru_utime)"


@pytest.mark.release
def test_installed_package_exports_a_model_file_from_an_empty_folder(
    site: Path, tmp_path: Path
) -> None:
    """To every target that a set without covariance has, in 5 s of processor time each."""
    python("-c", EXPORT, folder=tmp_path, path=site)
    for target in ("gazebo", "uuv", "mss", "pvs", "mujoco", "sitl", "python", "json"):
        words = ["export", "rov.json", "--to", target, "--lossy", "--name", "rov"]
        code = f"import sys; sys.argv[1:] = {words}\ntry:\n    {MAIN}"
        code += f"\nexcept SystemExit as end:\n    assert not end.code\n{RESOURCES}"
        seconds = python("-c", code, folder=tmp_path, path=site).split()[-1]
        assert float(seconds) < 5.0
        folder = tmp_path / f"exported/rov_{target}"
        assert (folder / f"README_rov_{target}.md").is_file()
        assert len(list(folder.iterdir())) >= 2


def test_modules_are_loaded_under_one_name() -> None:
    """Under pytest too: no file of ours stands twice in `sys.modules`."""
    for floor in FLOORS[:-1]:
        package = importlib.import_module(f"auvid.{floor}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    ours = [
        file
        for module in list(sys.modules.values())
        if (file := getattr(module, "__file__", None)) and Path(file).is_relative_to(ROOT)
        if ".venv" not in Path(file).parts
    ]
    assert len(ours) > 200
    assert [file for file, count in Counter(ours).items() if count > 1] == []


NAMES = {"pyyaml": "yaml", "rerun-sdk": "rerun", "pillow": "PIL"}
"""Distribution -> the package that is imported, where the two differ."""
BROUGHT = {"pydantic_core", "markupsafe", "fsspec", "rerun_bindings"}
"""Packages that pydantic, jinja2, s3fs and rerun cannot be without."""


def test_what_is_imported_is_declared() -> None:
    """Else `pip install auvid`, without what the extras bring, does not start."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    declared = {
        re.split(r"[<>=]", item)[0]
        for item in [*project["dependencies"], *extras["view"], *extras["plots"], *extras["dask"]]
    }
    allowed = {NAMES.get(name, name) for name in declared} | BROUGHT | {"auvid"}
    imported: set[str] = set()
    for floor in ("auvid", *FLOORS):
        for path in (ROOT / floor).rglob("*.py"):
            for node in statements(tree_of(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import):
                    imported |= {item.name.partition(".")[0] for item in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    imported.add(node.module.partition(".")[0])
    assert imported - allowed - set(sys.stdlib_module_names) == set()
