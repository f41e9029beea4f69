"""One bit of a result flipped: no command that reads it uses the other value silently.

By default a few bits of each kind of file, chosen by chance; `AUVID_FLIPS` sets how
many of each file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.commands.history import run_history
from auvid.pipeline.commands.look.diff.diff_operands import read_operand
from auvid.pipeline.commands.look.inspect.inspect_command import campaign_subject
from auvid.pipeline.commands.model.named_model import named_model
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.regress.regress_command import error_tables
from auvid.pipeline.commands.run.run_command import report_file
from auvid.results import open_run as open_results
from tests.support.campaign_runs import copy_workspace

FLIPS = int(os.environ.get("AUVID_FLIPS", "1"))
RUN = Path("runs/example")


@pytest.fixture(scope="module")
def workspace(short_workspace: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = copy_workspace(short_workspace, tmp_path_factory.mktemp("damaged"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


@contextmanager
def flipped(path: Path, bit: int) -> Iterator[None]:
    """Flip one bit of a file; the file comes back with its time."""
    content, status = path.read_bytes(), path.stat()
    damaged = bytearray(content)
    damaged[bit // 8] ^= 1 << bit % 8
    path.write_bytes(damaged)
    try:
        yield
    finally:
        path.write_bytes(content)
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


def history() -> None:
    if run_history.damaged(RUN):
        raise PipelineError("a damaged entry is named")


def models() -> None:
    for path in sorted(RUN.glob("model_file/model_file/*.json")):
        named_model(f"example/{path.stem}")


READERS: dict[str, tuple[Callable[[], object], tuple[str, ...]]] = {
    "diff": (
        lambda: read_operand("example"),
        (
            "*/manifest.json",
            "validate/error_table.parquet",
            "fuse/train/fused.parquet",
            "residual/check/residual.parquet",
            "synthesise/model_card/*.json",
            "validate/predictions/*.parquet",
            "resample/train/segment.json",
            "ingest/run/log_info.json",
        ),
    ),
    "report": (lambda: report_file("example"), ("report/report_html.html",)),
    "inspect": (lambda: campaign_subject(open_run("example")), ("report/recording.rrd",)),
    "regress": (
        lambda: error_tables(open_run("example")),
        ("validate/error_table.parquet", "ingest/run/imu.parquet", "validate/manifest.json"),
    ),
    "history": (history, ("history/*.json",)),
    "model": (models, ("model_file/model_file/*.json",)),
    "open_run": (
        lambda: list(open_results("example").values()),
        ("fuse/train/fused.parquet", "model_file/section.json"),
    ),
}


@pytest.mark.parametrize("command", READERS)
def test_no_command_uses_a_flipped_bit(workspace: Path, command: str) -> None:
    read, patterns = READERS[command]
    read()
    generator = np.random.default_rng(17)
    silent = []
    for pattern in patterns:
        paths = sorted(RUN.glob(pattern))
        assert paths, f"{pattern} names nothing"
        for path in paths:
            for bit in generator.integers(8 * path.stat().st_size, size=FLIPS):
                with flipped(path, int(bit)):
                    try:
                        read()
                    except (PipelineError, UserWarning):  # a run that is not as it was left
                        continue
                    silent.append(f"{path}: bit {bit}")
    assert silent == []
