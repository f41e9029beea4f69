"""The stream of a recording: series in chunks, states, messages, texts, a moving body.

One timeline `t` in seconds. Values keep 21 significant bits (5e-7 of their size, which
no eye tells and which packs better); times are exact to the nanosecond. Lines end where
the samples pause. Rerun stamps its chunks with the time of writing, so two recordings
of the same are equal by `rerun rrd compare`, not byte for byte.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun_bindings as bindings

from auvid.hydro.arrays import Array
from auvid.stages.number_format import visible
from auvid.stages.page.colours import AXIS_INKS, Ink
from auvid.stages.report.recording.identity import Property, recording_id

APPLICATION = "auvid"
TIMELINE = "t"
BINS_AT_ONCE = 1024
CHUNK_ROWS = 50_000
PREVIEW_BINS = 2000
KEPT_BITS = np.uint64(0xFFFF_FFFF_0000_0000)
HALF = np.uint64(1 << 31)
LEVELS = {"error": "ERROR", "warning": "WARN", "note": "INFO"}
AXIS_LENGTH_M = 0.6
NO_PROPERTIES: Mapping[str, Property] = {}


class Recording:
    """One recording, in memory or saved to `path` as it comes.

    Its id is that of title and `content`; `properties` are typed columns of a catalogue.

    `bins`: series of more than two samples a bin show the smallest and the largest value
    of each, at `log/thinned` in words; None shows every sample.
    """

    def __init__(
        self,
        title: str,
        *,
        content: object = "",
        properties: Mapping[str, Property] = NO_PROPERTIES,
        bins: int | None = None,
        path: str | None = None,
    ) -> None:
        self.stream = rr.RecordingStream(
            APPLICATION, recording_id=recording_id(title, content), send_properties=False
        )
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)
        self.bins, self._thinned = bins, 0
        self._sink = rr.binary_stream(recording=self.stream) if path is None else None
        if path is not None:
            self.stream.save(path)
        # Rerun joins what comes within some time into a chunk: flushed, both have one each.
        self.stream.send_recording_name(str(visible(title)))
        self.stream.flush()
        if properties:
            plain: dict[str, Any] = {
                name: str(visible(value)) if isinstance(value, str) else value
                for name, value in properties.items()
            }
            self.stream.send_property("auvid", rr.AnyValues(**plain))
            self.stream.flush()

    def finish(self, blueprint: Any) -> bytes:
        """End the recording with its blueprint; give what is in memory."""
        if self._thinned:
            assert self.bins is not None  # something is thinned
            many = f"{self._thinned} group{'s' * (self._thinned > 1)} of series"
            words = (
                f"{many} with more than {2 * self.bins} samples: shown are the smallest and the"
                f" largest value in each of {self.bins} bins"
            )
            self.messages("log/thinned", [(0.0, "note", words)])
        _send_blueprint(blueprint, self.stream)
        return self.discard()

    def discard(self) -> bytes:
        """End the recording and give what is in memory.

        Rerun keeps each stream, with two threads and some megabytes, until it is called
        upon to drop those that nobody refers to.
        """
        self.stream.flush()
        content = b"" if self._sink is None else self._sink.read(flush=True) or b""
        self.stream.disconnect()
        del self.stream, self._sink
        bindings.flush_and_cleanup_orphaned_recordings()
        return content

    def static(self, entity: str, value: Any) -> None:
        """Send one static value in a chunk of its own.

        Chunks then come in the same order every time.
        """
        self.stream.log(entity, value, static=True)
        self.stream.flush()

    def document(self, entity: str, markdown: str) -> None:
        """Send a text in Markdown.

        Characters that act on a terminal or turn the direction of writing are made
        visible.
        """
        self.static(
            entity, rr.TextDocument(str(visible(markdown)), media_type=rr.MediaType.MARKDOWN)
        )

    def series(self, entity: str, times: Array, values: Array, *, pause_s: float = np.inf) -> None:
        """Send series (n, k) at `times` (n,) in s.

        Lines are broken where samples pause longer than `pause_s`, and at the end.
        """
        times, values = broken(times, values, pause_s)
        self.columns(entity, times, values.T)

    def columns(self, entity: str, times: Array, lines: Iterable[Array]) -> None:
        """Send series of `times` (n,) in s, of long ones one (n,) after the other."""
        if self.bins is not None and times.size > 2 * self.bins:
            times, values = thinned(times, lines, self.bins)
            self._thinned += 1
        else:
            values = np.column_stack(list(lines))
        values = rounded(values)
        there = np.asarray(
            ~np.isnan(values).all(axis=1)
        )  # an empty row ends the line, also after the last sample
        for start in range(0, times.size, CHUNK_ROWS):
            part, kept = times[start : start + CHUNK_ROWS], there[start : start + CHUNK_ROWS]
            lengths = kept * values.shape[1]
            if start + CHUNK_ROWS >= times.size:
                step = times[-1] - times[-2] if times.size > 1 else 1e-3
                part, lengths = np.append(part, times[-1] + max(step, 1e-6)), np.append(lengths, 0)
            columns = rr.Scalars.columns(scalars=values[start : start + CHUNK_ROWS][kept].ravel())
            self.stream.send_columns(
                entity, [rr.TimeColumn(TIMELINE, duration=part)], columns.partition(lengths)
            )

    def states(
        self,
        entity: str,
        times: Sequence[float],
        states: Sequence[str | None],
        inks: Mapping[str, Ink],
    ) -> None:
        """Send a lane of spans: at each time in s the state that begins, None for none.

        `inks`: state -> its colour.
        """
        if inks:
            colours = [item.rgb for item in inks.values()]
            self.static(
                entity,
                rr.StateConfiguration(values=[str(visible(name)) for name in inks], colors=colours),
            )
        if not len(times):
            return
        columns = rr.StateChange.columns(
            state=[str(visible(state or "")) for state in states]
        )  # an empty state ends the span
        self.stream.send_columns(entity, [rr.TimeColumn(TIMELINE, duration=list(times))], columns)

    def messages(self, entity: str, rows: Sequence[tuple[float, str, str]]) -> None:
        """Send messages in the order of time.

        Each is (time in s, severity `error`, `warning` or `note`, text).
        """
        if not rows:
            return
        ordered = sorted(rows, key=lambda row: row[0])
        self.stream.send_columns(
            entity,
            [rr.TimeColumn(TIMELINE, duration=[time for time, _, _ in ordered])],
            rr.TextLog.columns(
                text=[str(visible(words)) for *_, words in ordered],
                level=[LEVELS[level] for _, level, _ in ordered],
            ),
        )

    def body(self, entity: str, times: Array, pose: Array) -> None:
        """Send a vehicle that moves along `pose` (n, 6), and its axes with it.

        Pose: position in m NED, Euler angles in rad.
        """
        self.stream.send_columns(
            entity,
            [rr.TimeColumn(TIMELINE, duration=times)],
            rr.Transform3D.columns(translation=pose[:, :3], quaternion=quaternions(pose[:, 3:])),
        )

    def body_axes(self, entity: str) -> None:
        """The axes x, y, z of a body, in the colours that axes have everywhere."""
        colours = [AXIS_INKS[name].rgb for name in ("x", "y", "z")]
        self.static(
            f"{entity}/axes",
            rr.Arrows3D(vectors=AXIS_LENGTH_M * np.eye(3), colors=colours, labels=["x", "y", "z"]),
        )


def rounded(values: Array) -> Array:
    """Values to the nearest of 21 significant bits; NaN and infinities stay."""
    bits = np.ascontiguousarray(values, dtype=np.float64).view(np.uint64)
    near = ((bits + HALF) & KEPT_BITS).view(np.float64)
    return np.where(np.isfinite(values) & np.isfinite(near), near, values)


def broken(times: Array, values: Array, pause_s: float) -> tuple[Array, Array]:
    """Return times (n,) and series (n, k) with a row of NaN after each long pause.

    A pause is long above `pause_s`.
    """
    after = np.flatnonzero(np.diff(times) > pause_s)
    if not after.size:
        return times, values
    break_times = times[after] + np.minimum(1e-3, pause_s)
    return np.insert(times, after + 1, break_times), np.insert(values, after + 1, np.nan, axis=0)


def thinned(times: Array, columns: Iterable[Array], bins: int) -> tuple[Array, Array]:
    """Return the smallest and the largest value of each series (n,) per bin: (m, k).

    At most two rows per bin, in the order in which they come.

    They stand at the first and at the middle time of the bin, so a peak is at most one
    bin away from its place. Bins without a finite value stay NaN.
    """
    n = times.size
    width = -(-n // bins)
    if width <= 2:
        return times, np.column_stack(list(columns))
    used = -(-n // width)
    thin = []
    for series in columns:  # one at a time, and of it some bins: little memory
        pairs = np.empty((used, 2))
        for start in range(0, used, BINS_AT_ONCE):
            part = series[start * width : (start + BINS_AT_ONCE) * width]
            blocks = np.append(part, np.full(-part.size % width, np.nan)).reshape(-1, width)
            lower = upper = blocks
            if not (finite := np.isfinite(blocks)).all():
                lower, upper = np.where(finite, blocks, np.inf), np.where(finite, blocks, -np.inf)
            low, high = lower.min(axis=1), upper.max(axis=1)
            rising = lower.argmin(axis=1) <= upper.argmax(axis=1)
            own = pairs[start : start + BINS_AT_ONCE]
            own[:, 0], own[:, 1] = np.where(rising, low, high), np.where(rising, high, low)
        thin.append(pairs.ravel())
    rows = np.column_stack(thin)
    rows[~np.isfinite(rows)] = np.nan
    first = np.arange(used) * width
    places = np.column_stack([first, np.minimum(first + width // 2, n - 1)]).ravel()
    kept = np.append(True, np.diff(places) > 0)
    return times[places][kept], rows[kept]


def quaternions(euler: Array) -> Array:
    """Return quaternions xyzw (n, 4), body to NED, of Euler angles (n, 3).

    Angles phi theta psi in the order z y x (Fossen 2011, 2.2).
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(euler.T / 2), np.sin(euler.T / 2)
    parts = [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]
    return np.column_stack(parts)


def _send_blueprint(blueprint: Any, stream: rr.RecordingStream) -> None:
    """Send a blueprint, and end the stream that it is made on.

    `stream.send_blueprint` leaves that in a circle with its memory, which nothing drops.
    """
    native = bindings.new_blueprint(
        application_id=APPLICATION, make_default=False, make_thread_default=False
    )
    made_on = rr.RecordingStream._from_native(native)
    made_on.set_time("blueprint", sequence=0)
    blueprint.to_blueprint()._log_to_stream(made_on)
    storage = bindings.memory_recording(native)
    if storage is not None:
        bindings.send_blueprint(storage, True, True, recording=stream.to_native())
    made_on.disconnect()
