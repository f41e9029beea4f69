"""`import auvid`: quick, lazy, and every public name documented."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import auvid

HEAVY = ("numpy", "pandas", "scipy", "numba", "pydantic", "rerun", "pyarrow", "matplotlib")
IMPORT = f"import sys, auvid; print([name for name in {HEAVY} if name in sys.modules])"


def test_the_import_loads_nothing_heavy(tmp_path: Path) -> None:
    """A time would depend on the machine; what takes time is named instead."""
    done = subprocess.run(
        [sys.executable, "-c", IMPORT], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", auvid.__all__)
def test_a_public_name_loads_and_is_documented(name: str) -> None:
    value = getattr(auvid, name)
    assert (value.__doc__ or "").strip()
    assert name in dir(auvid)


def public_callables() -> list[object]:
    names = ("read_log", "check", "run", "open_run", "open_model", "fit", "score")
    plots = [getattr(auvid.plots, name) for name in auvid.plots.__all__]
    model = [auvid.Model.load, auvid.Model.force, auvid.Model.simulate, auvid.Model.export]
    return [*(getattr(auvid, name) for name in names), *plots, *model]


@pytest.mark.parametrize("function", public_callables(), ids=lambda each: each.__qualname__)
def test_each_argument_is_described_in_numpy_style(function: object) -> None:
    words = inspect.getdoc(function) or ""
    assert "Parameters\n----------" in words
    assert "Returns\n-------" in words
    described = words.split("Parameters\n----------")[1].split("Returns\n-------")[0]
    names = [name for name in inspect.signature(function).parameters if name != "self"]  # type: ignore[arg-type]
    assert [name for name in names if name not in described] == []


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        auvid.fitt  # type: ignore[attr-defined]  # noqa: B018


def test_the_package_says_that_it_is_typed() -> None:
    assert (Path(auvid.__file__).parent / "py.typed").is_file()
