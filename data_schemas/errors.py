"""The error classes of auvid.

Every fault that a user can mend derives from `PipelineError`.
"""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable, Sequence

LISTED = 20
LONGEST_VALUE = 200


class _Short(reprlib.Repr):
    """Values of at most `LONGEST_VALUE` characters and a few levels."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxlong = 3, 60
        self.maxlist = self.maxtuple = self.maxdict = self.maxset = LISTED
        self.maxstring = self.maxother = LONGEST_VALUE

    def repr_int(self, x: int, level: int) -> str:
        short = x.bit_length() < 4096
        return super().repr_int(x, level) if short else "an integer too long to show"


def as_text(value: object) -> str:
    """Return a value as an error message shows it."""
    text = _Short().repr(value)
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 3]}..."


class PipelineError(Exception):
    """A fault in the user's input.

    It states file, row, field, value, what is allowed and the remedy.

    `row` counts as an editor counts (from 1, header included); for binary logs it is a
    message number or byte offset, written out.
    """

    def __init__(
        self,
        message: str,
        *,
        file: object = None,
        row: object = None,
        field: str | None = None,
        value: object = None,
        allowed: object = None,
        remedy: str | None = None,
    ) -> None:
        self.message = message
        self.file = file
        self.row = row
        self.field = field
        self.value = value
        self.allowed = allowed
        self.remedy = remedy
        super().__init__(str(self))

    def __reduce__(self) -> tuple[object, ...]:
        return (_rebuild, (type(self), self.message, self.__dict__))

    def __str__(self) -> str:
        where = [str(self.file)] if self.file is not None else []
        if self.row is not None:
            where.append(f"row {self.row}")
        if self.field is not None:
            where.append(f"field '{self.field}'")
        text = ": ".join([", ".join(where), self.message]) if where else self.message
        if self.value is not None:
            text += f"; found {as_text(self.value)}"
        if self.allowed is not None:
            allowed = self.allowed
            if not isinstance(allowed, str) and isinstance(allowed, Iterable):
                allowed = ", ".join(str(item) for item in allowed) or "none"
            text += f"; allowed: {allowed}"
        if self.remedy is not None:
            text += f". {self.remedy}"
        return text


_PARTS = ("file", "row", "field", "value", "allowed", "remedy")


def _rebuild(kind: type[PipelineError], message: str, state: dict[str, object]) -> PipelineError:
    error = kind(message)
    error.__dict__.update(state)
    error.args = (str(error),)
    return error


class UsageError(PipelineError):
    """A command with arguments that it does not take.

    Either a name is unknown, or options exclude each other.
    """

    @classmethod
    def of(cls, fault: PipelineError) -> UsageError:
        """Return a fault in what a command got as one of its words."""
        return cls(fault.message, **{name: getattr(fault, name) for name in _PARTS})


class SchemaError(PipelineError):
    """A table or document does not agree with its schema."""


class CampaignError(PipelineError):
    """The campaign, vehicle or parameter file asks for something that cannot be."""


class LogError(PipelineError):
    """A log file cannot be read as a log at all."""


class DataError(PipelineError):
    """Data that cannot give what a stage needs.

    For example a missing stream, too few samples, no validation leg.
    """


class ManyFaults(PipelineError):
    """All faults of one file together: the first twenty and the count."""

    def __init__(self, faults: Sequence[PipelineError] | str, *, file: object = None) -> None:
        self.faults = () if isinstance(faults, str) else tuple(faults)
        if isinstance(faults, str):
            super().__init__(faults, file=file)
            return
        lines = [str(fault) for fault in faults[:LISTED]]
        if len(faults) > LISTED:
            lines.append(f"... and {len(faults) - LISTED} more")
        super().__init__(f"{len(faults)} faults\n  " + "\n  ".join(lines), file=file)


def raise_faults(faults: Sequence[PipelineError], *, file: object = None) -> None:
    """Raise the one fault itself, or all of them together; return if there is none."""
    if len(faults) == 1:
        raise faults[0]
    if faults:
        raise ManyFaults(faults, file=file)


def nearest(word: object, choices: Iterable[str]) -> str | None:
    """A remedy sentence naming the known word nearest to a misspelt one, or None."""
    close = difflib.get_close_matches(str(word), list(choices), n=1, cutoff=0.5)
    return f"Did you mean '{close[0]}'?" if close else None
