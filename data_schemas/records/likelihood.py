"""What a fit by maximum likelihood says of sensors, noise and lag beside a model."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from auvid.data_schemas.documents.model import Model


class ChannelNoise(Model):
    """One measured quantity: its noise, and what the model leaves of it."""

    channel: str
    """Sensor and axis, as `velocity x`."""
    unit: str
    """SI unit."""
    samples: int
    """Samples of all legs."""
    noise_sd: float
    """Standard deviation of a sample, estimated."""
    normalised_rms: float
    """RMS error in parts of its predicted deviation: 1 where model and noise fit."""


class LegFit(Model):
    """What belongs to one leg alone; biases in body axes."""

    leg: str
    """The segment."""
    accel_bias_m_s2: list[float] | None
    """Bias of the accelerometer; null without one."""
    accel_bias_sd_m_s2: list[float] | None
    """Its standard deviation."""
    gyro_bias_rad_s: list[float]
    """Bias of the gyro."""
    gyro_bias_sd_rad_s: list[float]
    """Its standard deviation."""
    force_sd: dict[str, float] | None
    """Axis -> standard deviation of the unsteady force; null for output error."""


class LagFit(Model):
    """The lag of the actuators that a model goes with."""

    value_s: float
    """The lag."""
    standard_error_s: float | None
    """Its standard error; null at its bound, and of one stated without a spread."""
    verdict: Literal["identified", "weak", "inseparable", "at its bound", "stated"]
    """Inseparable: from an inertia, or from the lag of the velocity log. Stated: by the
    vehicle file.
    """
    correlations: dict[str, float] = Field(default_factory=dict)
    """Inertia fitted beside it -> correlation with the lag."""


class LikelihoodFit(Model):
    """How a model was fitted to the sensors, each at its own times."""

    estimator: Literal["output_error", "filter_error"]
    """Free motion from fitted starts, or innovations of a Kalman filter."""
    started_from: str
    """The model card it started from."""
    word: Literal["converged", "no convergence"]
    """How the iteration ended."""
    steps: int
    """Steps taken."""
    log_likelihood_gain: float
    """Rise of the log-likelihood from the start."""
    samples: int
    """Measured numbers of all sensors."""
    windows: int
    """Stretches of legs fitted."""
    weighted_residual: float
    """RMS of all errors in parts of their predicted deviations."""
    windows_differ: float | None = None
    """Mean square of what windows differ by over what noise makes of it; output error."""
    windows_agree: bool | None = None
    """Whether noise explains that; null where windows compare fewer directions than there
    are unknowns. Where it does not, the form lacks something: errors come from leaving
    windows out, and the distance from least squares counts in the intervals.
    """
    channels: list[ChannelNoise]
    """Per measured quantity: noise and normalised error."""
    legs: list[LegFit]
    """Per leg: biases, unsteady force."""
    force_time_s: dict[str, float] | None
    """Axis -> time constant of the unsteady force; null for output error."""
    limits_cost: float
    """By how much the limits lower the log-likelihood."""
    left_out: list[str] = Field(default_factory=list)
    """Legs and stretches that took no part, and why."""
