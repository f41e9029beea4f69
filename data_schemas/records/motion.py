"""What resample and fuse say of a segment."""

from __future__ import annotations

from typing import Literal

from auvid.data_schemas.documents.model import Model


class ChannelSmoothing(Model):
    """How the spline of one channel was chosen."""

    method: str
    """gcv, cutoff or none."""
    lam: float
    """Smoothing parameter."""
    cutoff_hz: float | None
    """Half-amplitude frequency; null without smoothing."""
    noise_sd: float | None
    """Standard deviation of the noise; null without smoothing."""
    sample_hz: float
    """Mean rate of the samples."""


class LegGap(Model):
    """A pause longer than allowed, in seconds from the start of the log."""

    stream: str
    """The stream that pauses."""
    start_s: float
    """Last sample before it."""
    end_s: float
    """First sample after it."""
    duration_s: float
    """Length."""


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
    """Length, without margins."""
    margins_s: list[float]
    """Data of the log before and after the segment on its clock, for what filters need."""
    samples: int
    """Rows of the uniform clock, without margins."""
    rate_hz: float
    """Rate of the uniform clock."""
    lags_s: dict[str, float]
    """Lag taken off each sensor."""
    smoothing: dict[str, ChannelSmoothing]
    """Per channel: how the spline was chosen (lambda, equivalent cutoff, noise
    estimate).
    """
    gaps: list[LegGap]
    """Gaps of the leg that split it."""
    notes: list[str]
    """Sentences a user should read."""


class InstallationFigure(Model):
    """One figure of how a sensor is installed, by the file and by the legs."""

    name: str
    """What it is, as `arm x`."""
    unit: str
    """Its unit."""
    departure: float
    """Estimate less the vehicle file's value."""
    standard_error: float | None
    """Of the departure; null where the legs show nothing of it."""
    limit: float
    """A departure counts beyond this size and three standard errors."""
    verdict: Literal["agrees", "departs", "not observable"]
    """not observable: a departure of twice the limit would not be seen for certain."""
    file_value: float | None
    """Value of the vehicle file; null where it has none."""
    corrected: float | None
    """Value of the file with the departure, where it departs."""


class InstallationEstimate(Model):
    """Where the velocity log sits, by vehicle file and legs together."""

    arm_m: list[float]
    """Arm x y z."""
    angles_rad: list[float]
    """Rotation vector from the vehicle file's body axes of the log to the true ones."""
    lag_s: float
    """Lag beyond that of the vehicle file."""


class InstallationRecord(Model):
    """How velocity log and accelerometer are installed, by all legs together."""

    figures: list[InstallationFigure]
    """Arm, angles and lag of the velocity log, and scales."""
    estimate: InstallationEstimate | None
    """null where no leg could be checked, or the accelerometer's convention is wrong."""
    convention: str | None
    """What the accelerometer was taken for."""
    convention_found: str | None
    """What it measures by its readings, where that is another."""
    innovations: dict[str, float]
    """Mean squared innovation over its variance: about 1 where the noise is as assumed."""
    legs: list[str]
    """Segments that were checked."""
    left_out: dict[str, str]
    """Segment -> why it was not."""


class CurrentRecord(Model):
    """Water current of a segment."""

    verdict: Literal["observable", "not observable", "stated"]
    """Whether the sensors determine it, or the campaign states it."""
    reason: str
    """Why."""
    ned_m_s: list[float] | None
    """Mean current north, east, down; null where not observable."""
    sd_m_s: list[float] | None
    """Its standard deviations; null where not observable or stated."""


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
    installation: Literal["vehicle_file", "estimate"] = "vehicle_file"
    """Where the velocity log was taken to sit."""
    current: CurrentRecord | None = None
    """Water current, where it was asked for: verdict (observable, not observable,
    stated), reason, ned_m_s, sd_m_s.
    """
    rms: dict[str, float]
    """RMS of raw minus fused per channel."""
    warnings: list[str]
    """Sentences a user should read."""
