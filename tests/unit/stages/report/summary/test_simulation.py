"""What free runs say a model can simulate."""

from __future__ import annotations

import pyarrow as pa

from auvid.stages.report.summary.simulation import simulation

NAMES = (
    *(f"{name}_rms_m_s" for name in "uvw"),
    *(f"{name}_rms_rad_s" for name in "pqr"),
    *(f"{name}_rms_rad" for name in ("phi", "theta", "psi")),
)


def table(*rows: tuple[str, int, tuple[float, ...]]) -> pa.Table:
    heads = [
        {"model": model, "horizon_s": 10.0, "starts": 4, "diverged": lost}
        for model, lost, _ in rows
    ]
    values = [dict(zip(NAMES, errors, strict=True)) for *_, errors in rows]
    return pa.Table.from_pylist([head | row for head, row in zip(heads, values, strict=True)])


def test_a_rotation_is_of_use_only_with_its_angle() -> None:
    """Roll rate and pitch rate are better than no change, but roll angle is worse."""
    found = simulation(
        table(
            ("good", 0, (0.1, 0.1, 0.3, 0.1, 0.1, 0.1, 0.3, 0.1, 0.1)),
            ("lost", 1, (0.1,) * 9),
            ("persistence", 0, (0.2,) * 9),
        )
    )
    assert found is not None
    assert found.useful["good"] == ("X", "Y", "M", "N")
    assert found.holds("good")
    assert not found.holds("lost")
    assert not found.holds("never flown")


def test_without_a_run_there_is_nothing_to_say() -> None:
    assert simulation(None) is None
