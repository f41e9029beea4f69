"""The table of mistakes that are made in a sound log."""

import pytest

from tests.faults.wrong_maps import example, rows


@pytest.mark.release
def test_the_table_says_what_is_stopped_named_and_silent() -> None:
    outcomes = {name: (outcome, findings) for name, outcome, findings in rows(example(), "depth")}
    assert outcomes["depth of another dive"] == ("stopped", "depth_unrelated")
    assert outcomes["depth zeroed anew"] == ("named", "depth_jumps")
    assert outcomes["depth 0.5 s late"][0] == "stopped"
    assert outcomes["depth not zeroed"] == ("note", "(depth_zero_unseen)")
