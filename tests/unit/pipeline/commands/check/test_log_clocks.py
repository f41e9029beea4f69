"""The clock of one log against those of the others of its campaign."""

from __future__ import annotations

from typing import Any

from auvid.pipeline.commands.check.log_clocks import log_clocks


def health(**lags: float) -> dict[str, Any]:
    """What a health document says of the lags of motions behind the outputs."""
    return {"answers": {axis: {"lag_s": lag, "explained": 0.8} for axis, lag in lags.items()}}


def test_the_log_whose_outputs_are_late_is_named_with_its_size() -> None:
    logs = {
        "first": health(u=0.27, w=0.50, r=0.33),
        "second": health(u=0.36, w=0.52, r=0.42),
        "third": health(u=-0.06, w=0.12, r=-0.04),
    }
    ((log, (item,)),) = log_clocks(logs).items()
    assert log == "third"
    assert item["id"] == "run_clock"
    assert "0.39 s sooner than in 'first' and 'second'" in item["text"], item["text"]
    assert "or another vehicle" in item["text"]
    assert item["fields"] == ["time_us"]


def test_lags_of_single_axes_are_how_a_vehicle_is_driven() -> None:
    """Three runs in a tank whose sway and heave follow as a pilot moves them."""
    logs = {
        "a": health(u=0.61, v=0.71, w=0.86, r=0.33),
        "b": health(u=0.62, v=0.49, w=0.64, r=0.74),
        "c": health(u=0.58, v=0.35, w=1.20, r=0.28),
        "d": {"answers": {}},
    }
    assert log_clocks(logs) == {}
    assert log_clocks({"a": health(u=0.9), "b": health(u=0.2)}) == {}
