"""Of several runs one is held out: one that the others can do without."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from auvid.pipeline.commands.new.feedable import judging_log


@pytest.mark.parametrize(
    ("axes", "spans_s", "judge"),
    [
        (["XYZN", "XYZ", "X"], [165.0, 215.0, 40.0], 1),
        (["XYZN", "XYZN", "XYZN"], [165.0, 215.0, 40.0], 2),
        (["XYZN", "XYZN"], [165.0, 20.0], 0),
        (["XY", "ZN"], [100.0, 100.0], None),
        (["XYZN"], [100.0], None),
        (["XYZN", ""], [100.0, 100.0], None),
    ],
)
def test_the_others_feed_all_that_it_feeds(
    axes: Sequence[str], spans_s: Sequence[float], judge: int | None
) -> None:
    assert judging_log(axes, spans_s) == judge
