"""What the user asked of the output, the answer of a command, and its exit code.

With --json, standard output holds one JSON document and nothing else: the envelope of
docs/command_line.md.
"""

from __future__ import annotations

import functools
import inspect
import io
import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from auvid import __version__
from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.terminal import plain_lines

RUNNING, LOOKING, USING = "From logs to a model", "Look at a run or a log", "Use a model"
COMPARING, TWINS, LISTING = "Compare and test", "Twins and theory", "Lists and schemas"
PANELS = (RUNNING, LOOKING, USING, COMPARING, TWINS, LISTING)
"""Headings of the help, under which commands stand by task."""
FORMAT = 1
"""Number of the envelope's layout; it goes up when a reader of the old one would fail."""
FINE, FAILED, WRONG_USE, LOSSES, INTERRUPTED = 0, 1, 2, 3, 130
EXIT_CODES = {
    FINE: "done; what was compared is equal, what was checked holds",
    FAILED: (
        "refused or failed: a file, a log or a result is at fault, a comparison or a bound"
        " does not hold"
    ),
    WRONG_USE: "wrong use: a word on the command line is at fault, nothing was done",
    LOSSES: "done, with losses: damaged logs, rejected samples, legs cut short",
    INTERRUPTED: "interrupted; what was finished is kept",
}
"""Of every command; docs/command_line.md prints them."""


@dataclass
class Output:
    """Options of the output that every command takes, and what it has to tell.

    `answer` is None until the command knows it; `notes` are lines beside it.
    """

    json: bool = False
    quiet: bool = False
    verbose: bool = False
    command: str = ""
    answer: Any = None
    notes: list[str] = field(default_factory=list)
    printed: bool = False


OUTPUT = Output()
"""Of the command that runs in this process."""


def start(words: Sequence[str]) -> None:
    """Forget what an earlier command in this process left, for one with these words."""
    vars(OUTPUT).update(vars(Output(json="--json" in words)))


def answer(document: object) -> None:
    """Keep the answer of the command for --json."""
    OUTPUT.answer = document


def note(line: str) -> None:
    """Print a line beside the answer to standard error, unless --quiet."""
    OUTPUT.notes.append(line)
    if not OUTPUT.quiet:
        print(plain_lines(line), file=sys.stderr)


def envelope(status: int, fault: PipelineError | str | None = None) -> str:
    """Return the JSON document of a command that ends."""
    document = {
        "format": FORMAT,
        "auvid": __version__,
        "command": OUTPUT.command,
        "exit_code": status,
        "answer": OUTPUT.answer if fault is None else None,
        "notes": OUTPUT.notes,
        "error": None if fault is None else _error(fault),
    }
    return json.dumps(plain_values(document), indent=2, ensure_ascii=False, allow_nan=False)


def print_envelope(status: int, fault: PipelineError | str | None = None) -> None:
    """Print the envelope where --json asks for it and none is printed yet."""
    if OUTPUT.json and not OUTPUT.printed:
        OUTPUT.printed = True
        print(envelope(status, fault))


def _error(fault: PipelineError | str) -> dict[str, Any]:
    if isinstance(fault, str):
        return {"kind": "Fault", "text": fault}
    allowed = fault.allowed
    return {
        "kind": type(fault).__name__,
        "text": str(fault),
        "message": fault.message,
        "file": None if fault.file is None else str(fault.file),
        "row": fault.row,
        "field": fault.field,
        "value": fault.value,
        "allowed": allowed if allowed is None or isinstance(allowed, str) else list(allowed),  # type: ignore[call-overload]
        "remedy": fault.remedy,
    }


def plain_values(value: Any) -> Any:
    """Return a value as JSON takes it: what is no number is null, a path is text."""
    if isinstance(value, Mapping):
        return {str(key): plain_values(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set):
        return [plain_values(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, Path):
        return str(value)
    return plain_values(value.item()) if hasattr(value, "item") else str(value)


Json = Annotated[bool, typer.Option("--json", help="Print the answer as JSON, and nothing else.")]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print the answer only: no progress, no warnings.")
]
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose", "-v", help="Print every item with its seconds, lists in full, tracebacks."
    ),
]


COMMON = {"json": Json, "quiet": Quiet, "verbose": Verbose}
"""Options of every command with an answer, by name."""


def answering(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command --json, --quiet and --verbose.

    With --json what it prints is left out, and its answer is printed in the envelope.
    """

    @functools.wraps(command)
    def run(*, json: bool, quiet: bool, verbose: bool, **options: Any) -> None:
        fresh = Output(json, quiet, verbose, command.__name__)
        vars(OUTPUT).update(vars(fresh))
        if not json:
            _until_its_end(command, options)
            return
        with redirect_stdout(io.StringIO()):
            status = _status(command, options)
        print_envelope(status)
        raise typer.Exit(status)

    signature = inspect.signature(command, eval_str=True)
    added = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in COMMON.items()
    ]
    own = [
        item.replace(kind=inspect.Parameter.KEYWORD_ONLY) for item in signature.parameters.values()
    ]
    run.__dict__["__signature__"] = signature.replace(parameters=[*own, *added])
    run.__annotations__ = {**command.__annotations__, **COMMON}
    return run


def _status(command: Callable[..., None], options: Mapping[str, Any]) -> int:
    """Run a command and return its exit code."""
    try:
        _until_its_end(command, options)
    except typer.Exit as end:
        return end.exit_code
    return FINE


def _until_its_end(command: Callable[..., None], options: Mapping[str, Any]) -> None:
    """Run a command; Ctrl-C ends it with its own exit code."""
    try:
        command(**options)
    except KeyboardInterrupt:
        print("interrupted: what was finished is kept", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None


class Command(TyperCommand):
    """A command whose help names no types of flags and arguments."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters without these types."""
        return _without_types(super().get_params(ctx))


class Commands(TyperGroup):
    """All commands, those of one task together."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters without types of flags."""
        return _without_types(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words; without any, print the help and end as wrong use."""
        if not args and not ctx.resilient_parsing:
            print(ctx.get_help())
            raise typer.Exit(WRONG_USE)
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names by the order of the panels."""
        names = super().list_commands(ctx)
        panels = {name: getattr(self.commands[name], "rich_help_panel", None) for name in names}
        return sorted(names, key=lambda name: PANELS.index(panels[name] or LISTING))

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help as plain text; what draws boxes takes as long as the rest."""
        super(TyperGroup, self).format_help(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands under the heading of their task."""
        rows: dict[str, list[tuple[str, str]]] = {}
        for name in self.list_commands(ctx):
            command = self.commands[name]
            if command.hidden:
                continue
            words = inspect.cleandoc(command.help or "").split("\n\n")[0]
            panel = getattr(command, "rich_help_panel", None) or "Commands"
            rows.setdefault(panel, []).append((name, " ".join(words.split())))
        for panel, lines in rows.items():
            with formatter.section(panel):
                formatter.write_dl(lines)


def _usage(argument: Any, ctx: Any) -> list[str]:
    """Return how an argument stands in the line of usage: `NAME` or `[NAME]`."""
    name = argument.metavar
    return [name if argument.required or argument.hidden else f"[{name}]"]


def _without_types(params: list[Any]) -> list[Any]:
    for param in params:
        if param.param_type_name == "argument":
            param.display_type_rich = lambda ctx: None
            param.get_usage_pieces = functools.partial(_usage, param)
        elif param.is_flag and param.metavar is None:
            param.metavar = ""
    return params
