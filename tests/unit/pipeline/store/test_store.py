"""The artefact store: what is written is whole, says its units, comes back equal, and
is the same bytes for the same content.
"""

from __future__ import annotations

import ast
import errno
import json
import os
import stat
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from auvid.data_schemas.errors import DataError, PipelineError, SchemaError
from auvid.data_schemas.tables import TableParts, make_table
from auvid.pipeline.graph import Graph, stages_of_kind
from auvid.pipeline.store import artefacts, file_hashes, pipes
from auvid.pipeline.store.artefacts import encode, in_pieces, load, to_json, to_plain
from auvid.pipeline.store.atomic_files import (
    SYSTEM_REFUSALS,
    TEMPORARY,
    contents,
    document_bytes,
    refuse_linked_folders,
    remove_stale_files,
    remove_temporary_files,
    write_atomically,
    write_output,
)
from auvid.pipeline.store.file_hashes import FileHashes, hash_bytes, hash_value
from auvid.pipeline.store.fingerprints import stage_code
from auvid.pipeline.store.import_closure import import_closure
from auvid.pipeline.store.pipes import saved_pieces
from auvid.stages.registry import KINDS, STAGES
from tests.support import toy_stages

SCALARS = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text()
)
JSON = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


def depth_table(rows: int = 5) -> pa.Table:
    return make_table(
        "depth",
        {"time_us": np.arange(rows, dtype=np.int64), "depth_m": np.linspace(0.0, 1.0, rows)},
    )


def test_table_comes_back_with_unit_frame_and_meaning(tmp_path: Path) -> None:
    path = tmp_path / "depth.parquet"
    write_atomically(path, encode(depth_table(), "depth", file="x"))
    table = load(path, "depth")
    assert table.equals(depth_table())
    metadata = pq.read_schema(path).field("depth_m").metadata
    assert metadata == {
        b"unit": b"m",
        b"frame": b"NED",
        b"meaning": b"depth of the pressure sensor",
    }
    assert pq.ParquetFile(path).metadata.row_group(0).column(0).compression == "ZSTD"


@pytest.mark.parametrize(
    ("number", "remedy"), [(errno.EFBIG, "see ulimit -f"), (errno.ENOSPC, "Free some space")]
)
def test_a_limit_of_file_size_is_no_full_disk(number: int, remedy: str, tmp_path: Path) -> None:
    def pieces() -> Generator[bytes]:
        yield b"begun"
        raise OSError(number, os.strerror(number))

    with pytest.raises(PipelineError, match=rf"x: cannot be written.*{remedy}"):
        write_atomically(tmp_path / "x", pieces())
    assert list(tmp_path.iterdir()) == []
    assert SYSTEM_REFUSALS.pop().errno == number


def test_same_content_is_the_same_bytes_however_it_is_chunked() -> None:
    table = depth_table(1000)
    chunked = pa.concat_tables([table.slice(0, 17), table.slice(17, 400), table.slice(417)])
    assert encode(chunked, "depth", file="x") == encode(table, "depth", file="x")


def test_table_is_checked_on_write_and_on_read(tmp_path: Path) -> None:
    wrong = depth_table().rename_columns(["time_us", "depth_ft"])
    with pytest.raises(PipelineError, match="depth_ft"):
        encode(wrong, "depth", file="x")
    pq.write_table(wrong, tmp_path / "depth.parquet")
    with pytest.raises(PipelineError, match=r"(?s)depth.parquet.*depth_ft"):
        load(tmp_path / "depth.parquet", "depth")


@pytest.mark.parametrize(
    ("name", "artefact"), [("depth", b"bytes"), ("tables_text", "text"), ("section", {"title": 1})]
)
def test_artefact_of_another_kind_is_refused(name: str, artefact: object) -> None:
    with pytest.raises(PipelineError, match=r"output 'x'"):
        encode(artefact, name, file="output 'x'")


@pytest.mark.parametrize("content", [b"", b"PAR1", b"{", b"\xff\xfe"])
def test_damaged_artefact_is_a_clear_error(content: bytes, tmp_path: Path) -> None:
    for name in ("depth.parquet", "section.json"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(SchemaError, match=rf"{name}: cannot be read.*Remove the file"):
            load(tmp_path / name, name.partition(".")[0])


def test_altered_artefact_is_noticed_by_its_hash(tmp_path: Path) -> None:
    write_atomically(tmp_path / "depth.parquet", encode(depth_table(), "depth", file="x"))
    with pytest.raises(SchemaError, match="not what its manifest says"):
        load(tmp_path / "depth.parquet", "depth", expected="0" * 64)


def test_a_table_that_has_not_changed_is_hashed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, hashed = tmp_path / "depth.parquet", []

    def counted(file: Path) -> str:
        hashed.append(file)
        return hash_bytes(file.read_bytes())

    monkeypatch.setattr(file_hashes, "hash_file", counted)
    path.write_bytes(content := encode(depth_table(), "depth", file="x"))
    digest = hash_bytes(content)
    for _ in range(2):
        load(path, "depth", digest)
    assert len(hashed) == 2, "a young file may change again at the same time"
    monkeypatch.setattr(file_hashes, "SETTLED_S", -1.0)
    for _ in range(3):
        load(path, "depth", digest)
    assert len(hashed) == 3
    write_atomically(path, content[:-9] + b"x" * 9)
    with pytest.raises(SchemaError, match="not what its manifest says"):
        load(path, "depth", digest)


def test_a_disk_that_refuses_a_table_is_no_damage_of_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    path = tmp_path / "depth.parquet"
    path.write_bytes(b"")
    monkeypatch.setattr(artefacts, "_read_parquet", refuse)
    with pytest.raises(PipelineError, match="cannot be read: Input/output error") as caught:
        load(path, "depth")
    assert not isinstance(caught.value, SchemaError)
    assert SYSTEM_REFUSALS.pop().errno == errno.EIO


def test_documents_hold_plain_finite_values_only() -> None:
    assert to_plain({"a": np.float64(1.5), "b": np.arange(2), "c": (True, None)}) == {
        "a": 1.5,
        "b": [0, 1],
        "c": [True, None],
    }
    with pytest.raises(SchemaError, match=r"field 'a\[1\]': no number"):
        to_plain({"a": [1.0, float("nan")]}, file="x")
    with pytest.raises(SchemaError, match="cannot hold this"):
        to_plain({"a": {1, 2}})


@given(JSON)
def test_json_layout_changes_no_value(value: object) -> None:
    assert json.loads(to_json(value)) == value


def test_json_is_one_key_a_line_and_keeps_the_order() -> None:
    document = {"z": [1, 2, 3], "a": {"x": {"deep": [{"y": 1}]}}, "text": "u'"}
    assert to_json(document).splitlines() == [
        "{",
        ' "z": [1, 2, 3],',
        ' "a": {',
        '  "x": {',
        '   "deep": [',
        '    {"y": 1}',
        "   ]",
        "  }",
        " },",
        ' "text": "u\'"',
        "}",
    ]


def test_write_replaces_as_a_whole_and_leaves_no_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "deep" / "x.json"
    write_atomically(path, b"old")

    def fail(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(
        PipelineError, match=r"x.json: cannot be written: No space left on device.*Free some space"
    ):
        write_atomically(path, b"new")
    assert [entry.name for entry in path.parent.iterdir()] == ["x.json"]
    assert path.read_bytes() == b"old"


def test_prune_and_sweep(tmp_path: Path) -> None:
    for name in ("keep/a", "drop/b", "keep/c"):
        write_atomically(tmp_path / name, b"")
    remove_stale_files(tmp_path, {tmp_path / "keep" / "a"}, {"a", "b", "c"})
    assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")) == [
        "keep",
        "keep/a",
    ]
    (tmp_path / "keep" / f".a.77{TEMPORARY}").touch()
    remove_temporary_files(tmp_path)
    assert [path.name for path in (tmp_path / "keep").iterdir()] == ["a"]


def test_only_files_with_names_of_artefacts_are_removed(tmp_path: Path) -> None:
    for name in ("leg/depth.parquet", "mode/old.parquet", "leg/notes.md", "letter.txt"):
        write_atomically(tmp_path / name, b"")
    remove_stale_files(tmp_path, set(), {"depth", "mode"})
    assert {path.name for path in tmp_path.rglob("*.*")} == {"notes.md", "letter.txt"}
    assert not (tmp_path / "mode").exists()


def test_temporary_files_of_live_processes_and_of_others_stay(tmp_path: Path) -> None:
    names = (f".x.{os.getppid()}{TEMPORARY}", f".draft{TEMPORARY}", f".y.4194305{TEMPORARY}")
    for name in names:
        (tmp_path / name).touch()
    remove_temporary_files(tmp_path, of="x")
    assert {path.name for path in tmp_path.iterdir()} == set(names)
    remove_temporary_files(tmp_path, shared=True)
    assert {path.name for path in tmp_path.iterdir()} == set(names[:2])
    remove_temporary_files(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {names[1]}


@pytest.mark.parametrize("link", ["decode", "decode/a"])
def test_linked_folder_of_results_is_refused(tmp_path: Path, link: str) -> None:
    mine = tmp_path / "mine"
    write_atomically(mine / "depth.parquet", b"mine")
    (tmp_path / link).parent.mkdir(exist_ok=True)
    (tmp_path / link).symlink_to(mine)
    with pytest.raises(PipelineError, match=f"{link}: the folder of results is a link"):
        refuse_linked_folders(tmp_path / "decode")
    (tmp_path / "runs").symlink_to(tmp_path / "elsewhere")
    refuse_linked_folders(tmp_path / "runs" / "decode")


def test_a_file_without_end_is_no_document(tmp_path: Path) -> None:
    path = tmp_path / "campaign.yaml"
    path.write_bytes(b"kind: twin")
    assert document_bytes(path, file=path, what="file") == b"kind: twin"
    os.truncate(path, 20_000_000_000)
    with pytest.raises(PipelineError, match=r"too large for a document.* 20000 MB.*at most 17 MB"):
        document_bytes(path, file=path, what="file")


def test_output_goes_through_links_and_into_what_is_no_file(tmp_path: Path) -> None:
    page, latest = tmp_path / "page.html", tmp_path / "latest.html"
    page.write_text("old")
    page.chmod(0o600)
    latest.symlink_to(page)
    (tmp_path / f".page.html.4194305{TEMPORARY}").touch()
    write_output(latest, b"new")
    assert (page.read_bytes(), latest.is_symlink()) == (b"new", True)
    assert stat.S_IMODE(page.stat().st_mode) == 0o600
    assert {path.name for path in tmp_path.iterdir()} == {"page.html", "latest.html"}
    reader, writer = os.pipe()
    write_output(Path(f"/dev/fd/{writer}"), b"piped")
    assert os.read(reader, 9) == b"piped"
    with pytest.raises(PipelineError, match="/dev/full: cannot be written: No space left"):
        write_output(Path("/dev/full"), b"x")
    with pytest.raises(PipelineError, match="it is a folder"):
        write_output(tmp_path, b"x")


@pytest.mark.skipif(not os.access("/dev/shm", os.W_OK), reason="no RAM disk")
def test_a_file_of_a_ram_disk_is_replaced() -> None:
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        path = Path(folder, "page.html")
        path.write_text("old")
        write_output(path, b"new")
        assert path.read_bytes() == b"new"


@pytest.mark.parametrize("kind", ["fifo", "device"])
def test_what_is_no_regular_file_is_refused_before_it_is_read(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "x"
    os.mkfifo(path) if kind == "fifo" else path.symlink_to("/dev/zero")
    with pytest.raises(PipelineError, match="log is no regular file"):
        contents(path, file=path, what="log")
    with pytest.raises(OSError, match="no regular file"):
        FileHashes().of(path)


def test_edit_whose_time_is_set_back_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, settled = tmp_path / "x", time.time() + 100.0
    monkeypatch.setattr(time, "time", lambda: settled)
    path.write_bytes(b"one")
    hashes, stamp = FileHashes(), path.stat().st_mtime_ns
    first = hashes.of(path)
    assert hashes._known
    time.sleep(0.02)  # more than a tick of the file system's clock
    path.write_bytes(b"two")
    os.utime(path, ns=(stamp, stamp))
    assert hashes.of(path) != first


def test_file_hashes_notice_change_and_forget_what_is_gone(tmp_path: Path) -> None:
    path, memory = tmp_path / "x", tmp_path / ".hashes.json"
    path.write_bytes(b"one")
    long_ago = time.time() - 100.0
    os.utime(path, (long_ago, long_ago))
    hashes = FileHashes(memory)
    first = hashes.of(path)
    hashes.save()
    assert FileHashes(memory).of(path) == first
    path.write_bytes(b"two")
    assert FileHashes(memory).of(path) != first
    path.unlink()
    with pytest.raises(FileNotFoundError):
        FileHashes(memory).of(path)
    memory.write_text("[broken")
    path.write_bytes(b"one")
    assert FileHashes(memory).of(path) == first


def test_young_file_is_hashed_again(tmp_path: Path) -> None:
    """Two writes of one length within a tick of the file system's clock must not be
    taken for one.
    """
    path = tmp_path / "x"
    path.write_bytes(b"one")
    hashes = FileHashes()
    first, stamp = hashes.of(path), path.stat().st_mtime_ns
    path.write_bytes(b"two")
    os.utime(path, ns=(stamp, stamp))
    assert hashes.of(path) != first


def test_value_hash_ignores_the_order_of_keys_only() -> None:
    assert hash_value({"a": 1, "b": [1, 2]}) == hash_value({"b": [1, 2], "a": 1})
    assert hash_value({"a": [1, 2]}) != hash_value({"a": [2, 1]})
    assert hash_value(1.0) != hash_value("1.0")


def test_closure_holds_what_a_stage_imports_and_nothing_else() -> None:
    fuse = import_closure("auvid.stages.fuse")
    assert {
        "auvid.stages.fuse",
        "auvid.stages.base",
        "auvid.hydro.dynamics.mechanics.kinematics",
        "auvid.hydro.identification.signals.splines",
        "auvid.data_schemas.tables",
    } <= set(fuse)
    assert not {
        "auvid.stages.registry",
        "auvid.stages.residual",
        "auvid.stages.ingest",
        "auvid.stages.ingest.decoded_log",
    } & set(fuse)
    assert not [name for name in fuse if name.startswith("auvid.pipeline")]
    assert {"auvid.stages.ingest.registry", "data_schemas/formats/streams.yaml"} <= set(
        import_closure("auvid.stages.ingest")
    )
    assert {"stages/page/templates/style.css", "stages/page/templates/page.html.j2"} <= set(
        import_closure("auvid.stages.report")
    )
    assert not {
        "auvid.hydro.dynamics.viscous.models",
        "auvid.hydro.identification.regression.least_squares",
    } & set(import_closure("auvid.stages.resample"))


def test_every_module_that_a_stage_loads_is_in_its_closure() -> None:
    """The closure is found in the source; what running Python imports for one stage
    alone must not go beyond it.
    """
    import subprocess
    import sys

    floors = ("auvid.data_schemas", "auvid.hydro", "auvid.stages")
    program = "import sys, auvid.stages.residual; print(*sorted(sys.modules))"
    loaded = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout
    root, ours = Path(__file__).parents[4], set()
    for name in set(loaded.split()):
        package = root / name.removeprefix("auvid.").replace(".", "/") / "__init__.py"
        bare = package.is_file() and len(ast.parse(package.read_text(encoding="utf-8")).body) < 2
        if name.startswith(floors) and not bare:
            ours.add(name)
    assert {"auvid.stages.residual", "auvid.data_schemas.documents"} <= ours
    assert ours <= set(import_closure("auvid.stages.residual"))
    assert "auvid.hydro.dynamics.equations_of_motion" in ours


def test_stages_have_different_code() -> None:
    assert len({stage_code(stage) for stage in STAGES}) == len(STAGES)
    assert len({stage_code(stage) for stage in toy_stages.STAGES}) == 4, (
        "schemas of the ports count, though the module is the same"
    )


def test_artefact_paths_of_the_real_graph_are_distinct() -> None:
    for kind in KINDS:
        graph = Graph(stages_of_kind(STAGES, KINDS, kind))
        paths = [
            (port.stage.name, port.path("item", "key" if port.many else None))
            for port in graph.outputs
        ]
        assert len(set(paths)) == len(paths)


def test_what_is_saved_comes_out_in_pieces_while_it_is_written() -> None:
    sizes = []

    def save(path: str) -> None:
        with open(path, "wb", buffering=0) as file:
            for _ in range(40):
                sizes.append(file.write(b"x" * 100_000))

    pieces = saved_pieces(save)
    first = next(pieces)
    assert sum(sizes) < 1_000_000  # the pipe holds the writer back
    assert len(first) + sum(map(len, pieces)) == 4_000_000


def test_what_saves_itself_ends_when_nobody_asks_for_more() -> None:
    ends = []

    def save(path: str) -> None:
        with open(path, "wb", buffering=0) as file:
            try:
                for _ in range(300):
                    file.write(b"x" * 100_000)
                    time.sleep(0.01)
                ends.append("its own")
            except SystemExit:
                file.write(b"x" * 1_000_000)  # what a recording still has to write
                ends.append("asked for")
                raise

    pieces = saved_pieces(save)
    next(pieces)
    pieces.close()
    assert ends == ["asked for"]


def test_a_long_table_is_written_while_it_is_encoded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipes, "PIECE_BYTES", 300)
    table = depth_table(13)
    content = encode(table, "depth", file="x")
    assert list(in_pieces(table, "depth", file="x")) == [content]
    monkeypatch.setattr(artefacts, "LONG_TABLE_BYTES", 0)
    pieces = list(in_pieces(table, "depth", file="x"))
    assert len(pieces) > 1
    assert b"".join(pieces) == content
    monkeypatch.setattr(artefacts, "GROUP_ROWS", 3)
    expected = encode(table, "depth", file="x")
    lengths = (0, 1, 5, 9, table.num_rows)
    parts = TableParts(lambda: (table[low:high] for low, high in pairwise(lengths)))
    assert b"".join(in_pieces(parts, "depth", file="x")) == expected
    wrong = table.append_column("odd", table.column(0))
    for artefact in (wrong, TableParts(lambda: iter([wrong]))):
        with pytest.raises(SchemaError, match="unknown column"):
            list(in_pieces(artefact, "depth", file="x"))


def test_some_columns_of_a_table_are_read_with_its_clock(tmp_path: Path) -> None:
    path = tmp_path / "depth.parquet"
    path.write_bytes(content := encode(depth_table(), "depth", file="x"))
    digest = hash_bytes(content)
    part = load(path, "depth", digest, ["depth_m", "not_there"])
    assert part.equals(depth_table().select(part.column_names))
    assert sorted(part.column_names) == ["depth_m", "time_us"]
    assert load(path, "depth", digest, ["time_us"]).column_names == ["time_us"]
    with pytest.raises(SchemaError, match="not what its manifest says"):
        load(path, "depth", "0" * 64, ["depth_m"])


def test_rows_of_some_times_are_read_without_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(artefacts, "GROUP_ROWS", 10)
    path, table = tmp_path / "depth.parquet", depth_table(95)
    path.write_bytes(content := encode(table, "depth", file="x"))
    digest = hash_bytes(content)
    rows = {
        times: load(path, "depth", digest, times=times)
        for times in ((25.0, 39.0), (40.0, 40.0), (-np.inf, np.inf), (95.0, 200.0))
    }
    expected = [(20, 20), (40, 10), (0, 95), (0, 0)]
    for part, (start, count) in zip(rows.values(), expected, strict=True):
        assert part.equals(table.slice(start, count))


@pytest.mark.parametrize("opens", [True, False])
def test_a_fault_of_what_saves_itself_comes_through(tmp_path: Path, opens: bool) -> None:
    def save(path: str) -> None:
        if opens:
            open(path, "wb").close()
        raise DataError("no such tab")

    with pytest.raises(DataError, match="no such tab"):
        write_atomically(tmp_path / "out", saved_pieces(save))
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_ends_what_saves_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = Path.open

    def refusing(path: Path, *words: Any, **options: Any) -> Any:
        file = real(path, *words, **options)
        if path.name.endswith(TEMPORARY):
            os.dup2(os.open("/dev/full", os.O_WRONLY), file.fileno())
        return file

    def save(path: str) -> None:
        with open(path, "wb", buffering=0) as file:
            for _ in range(100):
                file.write(b"x" * 100_000)

    monkeypatch.setattr(Path, "open", refusing)
    with pytest.raises(PipelineError, match="No space left") as kept:
        write_atomically(tmp_path / "out", saved_pieces(save))
    assert (
        kept.value is not None
    )  # its traceback holds the generators: they are closed all the same
    assert list(tmp_path.iterdir()) == []


@pytest.mark.timeout(30)
def test_an_interruption_lets_the_writer_go_that_has_not_opened_yet(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looks = iter([KeyboardInterrupt])
    written = []

    def interrupted(*words: Any) -> Any:
        for fault in looks:
            raise fault
        return select(*words)

    def save(path: str) -> None:
        try:
            time.sleep(0.2)
        finally:  # what a recording still has to write at its end
            with open(path, "wb", buffering=0) as file:
                written.extend(file.write(b"x" * 100_000) for _ in range(20))

    select = pipes.select.select
    monkeypatch.setattr(pipes.select, "select", interrupted)
    with pytest.raises(KeyboardInterrupt):
        next(saved_pieces(save))
    assert sum(written) == 2_000_000


def test_loops_that_numba_can_keep_nowhere_are_kept_for_this_process(tmp_path: Path) -> None:
    """As in a container: the packages belong to another user, and there is no home."""
    program = """
import os, sys
from pathlib import Path
from auvid.pipeline.store import loop_folder
os.environ.pop(loop_folder.VARIABLE, None)
loop_folder.PACKAGE = Path("/proc/none")
loop_folder.keep_loops_somewhere()
print(os.environ[loop_folder.VARIABLE])
"""
    nowhere = {**os.environ, "HOME": "/proc/none", "XDG_CACHE_HOME": "", "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", program], env=nowhere, capture_output=True, text=True, check=True
    )
    assert Path(done.stdout.strip()).parent == tmp_path
    assert list(tmp_path.iterdir()) == []  # it goes with the process
    kept = {**nowhere, "XDG_CACHE_HOME": str(tmp_path)}
    refused = subprocess.run(
        [sys.executable, "-c", program], env=kept, capture_output=True, text=True, check=False
    )
    assert "KeyError: 'NUMBA_CACHE_DIR'" in refused.stderr
