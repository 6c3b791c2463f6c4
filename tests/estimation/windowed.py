"""Windows of simulated logs, and what many replicates of them say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from simulated import ORIGIN, Course, loosely, truth_of, twists_of, unknowns_of
from twin_drives import arcs

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gls import WeightedWindows
from oed.estimation.methods.two_stage import TwoStage
from oed.estimation.methods.windows import Windows
from oed.estimation.prediction.layout import cut
from oed.estimation.setup.unknowns import Knowledge, Unknowns
from oed.logs.log import Log
from oed.robots.models import SkidSteerIcr, Tricycle

PLACE = ("sensor_x", "sensor_y", "sensor_heading")
SITS = (0.03, -0.02, 0.05)
ICR = SkidSteerIcr(wheel_radius=0.05, y_icr_left=0.2, y_icr_right=-0.25, x_icr=0.05)
ICR_TRUTH = truth_of(ICR, y_icr_left=0.21, y_icr_right=-0.24, x_icr=0.06, alpha_right=0.95, alpha_left=1.02)
TRICYCLE = Tricycle(wheel_radius=0.05, wheelbase=0.3)
TRICYCLE_TRUTH = truth_of(TRICYCLE, wheel_radius=0.052, wheelbase=0.31, steering_offset=0.02)


def windows_of(logs: Sequence[Log], unknowns: Unknowns | None = None, seconds: float = 2.0) -> Windows:
    layout = cut(logs, seconds, [0.0] * len(logs))
    return Windows(layout, unknowns or unknowns_of(), np.zeros(len(layout.clocks)))


def gls(
    logs: Sequence[Log],
    unknowns: Unknowns | None = None,
    seconds: float = 2.0,
    known: Knowledge | None = None,
    **keys: Any,
) -> Fit:
    windows = windows_of(logs, unknowns, seconds)
    return WeightedWindows(windows, known or loosely(windows.unknowns), **keys).fit()


def two_stage(
    logs: Sequence[Log],
    unknowns: Unknowns | None = None,
    seconds: float = 2.0,
    known: Knowledge | None = None,
    **keys: Any,
) -> Fit:
    windows = windows_of(logs, unknowns, seconds)
    return TwoStage(windows, known or loosely(windows.unknowns), **keys).fit()


def drifting(drive: Course, parameters: np.ndarray, drift: Sequence[float], seed: int) -> Course:
    """The drive with errors of its steps that the wheels know nothing of.

    Args:
        drive: without them.
        parameters: true ones.
        drift: deviations ahead, sideways [m] and of the heading [rad] after 1 m of path, white, and perhaps
            of the heading after 1 rad of turning.
        seed: of the errors.
    """
    rng, steps = np.random.default_rng([seed, 3]), np.diff(drive.times)
    twists = twists_of(drive.model, drive.inputs, parameters)
    variances = np.abs(twists[:, :1]) * steps[:, None] * np.square(drift[:3])
    for by_turning in drift[3:]:
        variances[:, 2] += np.abs(twists[:, 2]) * steps * by_turning**2
    errors = np.sqrt(variances) / steps[:, None] * rng.normal(size=twists.shape)
    return replace(drive, states=arcs(ORIGIN, twists + errors, steps))


def misses(fit: Callable[[int], Fit], truth: np.ndarray, count: int) -> tuple[np.ndarray, list[Fit]]:
    """Errors of the estimates of replicates (count, p), and the fits."""
    fits = [fit(seed) for seed in range(count)]
    return np.array([one.values[: len(truth)] for one in fits]) - truth, fits


def spread(errors: np.ndarray, covariances: Sequence[np.ndarray]) -> np.ndarray:
    """Root mean square of errors in units of the standard errors that were promised for them, (p,)."""
    promised = np.array([np.diag(matrix)[: errors.shape[1]] for matrix in covariances])
    return np.sqrt((errors**2 / promised).mean(axis=0))
