"""What resample and fuse say of a segment."""

from __future__ import annotations

from typing import Literal

from auvid.data_schemas.documents.model import Model


class SegmentRecord(Model):
    """One segment, a leg or the part of it between gaps, and how it was resampled."""

    id: str
    """Leg id, with .1 .2 ... where gaps split the leg."""
    leg: str
    """The leg."""
    log: str
    """The log."""
    use: Literal["training", "validation"]
    """Fit or judge."""
    start_us: int
    """Boot clock at t_s = 0."""
    leg_start_s: float
    """Start of the segment in seconds from the first time-stamped record of the log."""
    duration_s: float
    """Length."""
    samples: int
    """Rows of the uniform clock."""
    rate_hz: float
    """Rate of the uniform clock."""
    lags_s: dict[str, float]
    """Lag taken off each sensor."""
    smoothing: dict[str, object]
    """Per channel: how the spline was chosen (lambda, equivalent cutoff, noise
    estimate).
    """
    gaps: list[dict[str, object]]
    """Gaps of the leg that split it."""
    notes: list[str]
    """Sentences a user should read."""


class FusionRecord(Model):
    """How one segment was fused, and what was found on the way."""

    segment: str
    """The segment."""
    method: Literal["kinematic", "thesis", "smoother", "truth"]
    """The method; truth: the true state of a twin."""
    as_published: bool
    """Whether the transport term was left in as the thesis does."""
    accelerometer: str | None = None
    """Convention used."""
    gyro_bias_rad_s: list[float] | None = None
    """Bias of p q r."""
    accel_bias_m_s2: list[float] | None = None
    """Bias of the accelerometer."""
    cutoff_hz: float | None = None
    """Zero-phase low-pass on all channels."""
    edge_s: float
    """Width cut at either end."""
    integrated_sway_rms_m_s: float | None = None
    """RMS of integrated against measured sway."""
    installation: dict[str, object] | None = None
    """Estimated arm and mounting of the velocity sensor, with standard deviations and
    what the data determine.
    """
    current: dict[str, object] | None = None
    """Water current, where it was asked for: verdict (observable, not observable),
    reason, ned_m_s, sd_m_s.
    """
    rms: dict[str, float]
    """RMS of raw minus fused per channel."""
    warnings: list[str]
    """Sentences a user should read."""
