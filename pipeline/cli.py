"""The command `auvid`: run a command line, and end with words and an exit code."""

from __future__ import annotations

import io
import os
import signal
import sys

from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.hydro.long_series import threads
from auvid.pipeline import output
from auvid.pipeline.command_line import campaigns, fleets, listings, models, runs  # noqa: F401
from auvid.pipeline.command_line.application import app
from auvid.pipeline.output import FAILED, OUTPUT, WRONG_USE
from auvid.pipeline.store.pipes import stop_threads
from auvid.pipeline.terminal import plain_lines


def main() -> None:
    """Run the command line; `output.EXIT_CODES` says how it ends."""
    for number in (signal.SIGTERM, signal.SIGINT):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as a shell starts work behind it
            signal.signal(number, _end)
    sys.stdout = sys.stdout or io.StringIO()  # a closed one is None
    sys.stderr = sys.stderr or io.StringIO()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # what a terminal cannot show is a ?
    output.start(sys.argv[1:])
    try:
        try:
            app(prog_name="auvid", standalone_mode=True)
        except SystemExit as end:
            if end.code == WRONG_USE:
                output.print_envelope(WRONG_USE, "wrong use: standard error says which word")
            raise
        except PipelineError as fault:
            status = WRONG_USE if isinstance(fault, UsageError) else FAILED
            output.print_envelope(status, fault)
            sys.exit(_say(f"error: {fault}", status))
        finally:
            print(end="", flush=True)
    except BrokenPipeError:
        _close_output()
        sys.exit(FAILED)
    except Exception as crash:
        if isinstance(crash, OSError) and (words := _refused(crash)):
            output.print_envelope(FAILED, words)
            sys.exit(_say(f"error: {words}", FAILED))
        output.print_envelope(FAILED, f"{type(crash).__name__}: {crash}")
        sys.exit(_say(_internal(crash), FAILED))


def _end(number: int, _: object) -> None:
    """End the work of this process, that of its threads too, on a signal."""
    stop_threads(threads.NAME)
    if number == signal.SIGINT:
        raise KeyboardInterrupt
    sys.exit(128 + number)


def _refused(fault: OSError) -> str | None:
    """Return in words what the system refused; None where auvid itself is at fault."""
    from auvid.pipeline.store.atomic_files import REMEDIES, refusal

    if fault.errno not in REMEDIES:
        return None
    if fault.filename is None:
        _close_output()
    words = "the system refused it" if fault.filename else "nothing more can be printed"
    return str(refusal(fault, words))


def _close_output() -> None:
    """Lead standard output to nowhere, so that Python's own flush at exit is quiet."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _internal(crash: Exception) -> str:
    """Return a fault of auvid in one line, with its traceback under AUVID_TRACEBACK."""
    import traceback

    trace = getattr(crash, "trace", "") or "".join(traceback.format_exception(crash))
    words = str(crash) if hasattr(crash, "trace") else f"{type(crash).__name__}: {crash}"
    if OUTPUT.verbose or os.environ.get("AUVID_TRACEBACK"):
        return f"{trace}\ninternal fault: {words}"
    return (
        f"internal fault: {words}\nThis is a fault of auvid, not of your data. --verbose (or"
        " AUVID_TRACEBACK=1) shows where it happened."
    )


def _say(line: str, status: int) -> int:
    print(plain_lines(line), file=sys.stderr)
    return status
