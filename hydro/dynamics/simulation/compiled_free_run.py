"""Free runs as one compiled loop: models and starts that share one measured motion.

The equations are those of `compiled.derivative`. Import this module only where free
runs are made: numba takes a second.
"""

from __future__ import annotations

import hashlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.simulation import compiled
from auvid.hydro.dynamics.simulation.compiled import (
    SOURCES,
    addresses,
    model_force,
    motion_rates,
)
from auvid.hydro.dynamics.simulation.plant_constants import Tables

STATES = 12
_address, _compiled = compiled._address, compiled._compiled


class Course(NamedTuple):
    """What all runs share, flat arrays: a measured motion, its inputs, and the starts.

    motion (n, 12), inputs (n, 12) as `derivative` has them, linear between samples.
    first (w,): samples of the starts. kept (k,): steps after a start at which a state
    is kept, ascending from 0. imposed (12,): 1 for states that are put in as measured.
    limits (12,): of the size of each state, beyond which a run is lost.
    """

    motion: Array
    inputs: Array
    first: NDArray[np.int64]
    kept: NDArray[np.int64]
    imposed: Array
    limits: Array
    samples: int
    step_s: float


class ModelRows(NamedTuple):
    """What tells the runs apart, a row per model.

    mass and inverse (m, 36), coefficients (m, 6 terms), trims (m, 6); deviation (m, 6)
    and rho (6,): a force that wanders as an autoregression from step to step, from
    `seeds` (m,); nothing where the deviation is 0.
    """

    mass: Array
    inverse: Array
    coefficients: Array
    trims: Array
    deviation: Array
    rho: Array
    seeds: NDArray[np.int64]


def _loop_over_models(sources: str) -> Any:
    """Return the compiled loop over models; numba keys what it keeps by `sources`."""

    def fly(
        course: Course, models: ModelRows, c: Tables, start: int, stop: int, scratch: Array,
        factors: Array, out: Array, lost: Array,
    ) -> None:  # fmt: skip
        """Fill `out` (m, w, k, 12) and `lost` (m, w) [s] for models `start` to `stop`.

        lost: seconds until a velocity is beyond its limit, nan for never. States after
        that, and after the end of the motion, stay as they are. scratch (6, 12) and
        factors (FACTOR_COUNT + terms,) are the caller's, which keeps them alive.
        """
        assert len(sources) > 0
        x, stage, slope = _address(scratch[0]), _address(scratch[1]), _address(scratch[2])
        total, acting, push = _address(scratch[3]), _address(scratch[4]), _address(scratch[5])
        terms, motion, inputs = _address(factors), _address(course.motion), _address(course.inputs)
        kept, last, step = course.kept, course.samples - 1, course.step_s
        fixed = addresses(c)
        for m in range(start, stop):
            # The generator of the loop's own thread, so that a model's draws are its own.
            np.random.seed(models.seeds[m])  # noqa: NPY002
            trim, deviation, rho = models.trims[m], models.deviation[m], models.rho
            own = Tables(
                _address(models.mass[m]), _address(models.inverse[m]), fixed.restoring,
                fixed.fins, fixed.propeller, fixed.inflow_per_u, fixed.factors,
                _address(models.coefficients[m]), fixed.strips, fixed.surfaces, fixed.counts,
                fixed.physical, fixed.body, fixed.axial, fixed.asymmetry, fixed.lag_s,
                fixed.minimum_speed,
            )  # fmt: skip
            for w in range(len(course.first)):
                result, place = out[m, w], 1
                for i in range(STATES):
                    x[i] = stage[i] = result[0, i] = motion[course.first[w] * STATES + i]
                    total[i] = 0.0
                for i in range(6):
                    push[i] = deviation[i] * np.random.normal()  # noqa: NPY002
                lost[m, w] = np.nan
                for s in range(min(kept[-1], last - course.first[w])):
                    low = (course.first[w] + s) * STATES
                    high = low + STATES
                    for part in range(4):
                        share = 0.5 * ((part + 1) // 2)
                        for i in range(STATES):
                            change = inputs[high + i] - inputs[low + i]
                            acting[i] = inputs[low + i] + share * change
                            if course.imposed[i] > 0.0:
                                change = motion[high + i] - motion[low + i]
                                stage[i] = motion[low + i] + share * change
                        for i in range(6):
                            acting[6 + i] += trim[i] + push[i]
                        viscous = model_force(stage, acting, own, terms)
                        motion_rates(stage, acting, viscous, own, slope)
                        weight = 2.0 if part == 1 or part == 2 else 1.0
                        ahead = step if part == 2 else 0.5 * step
                        for i in range(STATES):
                            total[i] += weight * slope[i]
                            stage[i] = x[i] + ahead * slope[i]
                    within = 0
                    for i in range(STATES):
                        x[i] += step / 6.0 * total[i]
                        if course.imposed[i] > 0.0:
                            x[i] = motion[high + i]
                        stage[i], total[i] = x[i], 0.0
                        if abs(x[i]) < course.limits[i]:
                            within += 1
                    if within < STATES:
                        lost[m, w] = (s + 1) * step
                        break
                    for i in range(6):
                        if deviation[i] > 0.0:
                            fresh = deviation[i] * np.sqrt(1.0 - rho[i] * rho[i])
                            push[i] *= rho[i]
                            push[i] += fresh * np.random.normal()  # noqa: NPY002
                    if s + 1 == kept[place]:
                        for i in range(STATES):
                            result[place, i] = x[i]
                        place += 1

    return _compiled(fly, cache=True)


fly: Any = _loop_over_models(hashlib.sha256("".join(SOURCES).encode()).hexdigest())
