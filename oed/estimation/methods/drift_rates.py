"""How fast a robot drifts beside what its inputs say: rates of a random walk, from the motions of windows.

Short logs cannot show them. Then they are thought to be what they are of robots whose logs did.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from oed.estimation.methods.faint_drift import faint_drift
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.log_errors import DRIFT, RATES, SIZES, USUALLY, drift_shows
from oed.estimation.methods.whole_logs import Likeliest
from oed.estimation.methods.window_noise import (
    OF_POSES,
    PARTS,
    TIMING,
    Course,
    Likelihood,
    drift_in_words,
    effects_of_ends,
)
from oed.estimation.methods.windows import READ, Motions, Windows
from oed.estimation.prediction.layout import SegmentLayout, cut, shortest_seconds
from oed.estimation.setup.unknowns import PLACE
from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.system import follows_state
from oed.logs.log import Log
from oed.robots.sensors import drift as usual_drift

USUAL = np.square([getattr(usual_drift.USUAL, rate) for rate in RATES])
"""Rates that are usual: ahead and sideways per path [m^2/m], turn per path [rad^2/m] and per turning
[rad^2/rad]; designs take the same for usual."""
USUAL_SPREAD = 2 * USUALLY
"""Standard deviation of their logarithms: of a drift after 1 m a factor of 2."""
POSE_SPREAD = 1.0
"""The same of the variance of poses, about that of the fit's residuals."""
ENOUGH, LONGEST = 10, 4
"""How many windows are enough, and how long they are at most, in units of the shortest segments: what shows
in shorter ones cancels within seconds."""
NEAR = 1 / 8
"""Share of a window over which poses are averaged to either side of its ends."""
OUTLYING = 4.0
"""Residuals beyond that many standard deviations are outliers where the loss is a robust one."""


@dataclass(frozen=True)
class DriftRates:
    """Of a random walk of the pose about what the inputs say.

    Attributes:
        values: variances ahead and sideways per path [m^2/m], of the turn per path [rad^2/m] and per turning
            [rad^2/rad], (4,).
        spread: covariance of their logarithms, (4, 4).
        shown: whether drift shows; False where logs show that there is none, None where they leave it open.
        seconds: length of the windows that they were found from [s], infinite for whole logs; None of what is
            only usual.
    """

    values: Array
    spread: Array
    shown: bool | None = None
    seconds: float | None = None

    @classmethod
    def of_whole_logs(cls, found: Likeliest) -> DriftRates:
        """Those that are most likely beside all else that errs in whole logs."""
        places = [SIZES.index(name) for name in DRIFT]
        logs = found.logs[places]
        return cls(np.exp(2 * logs), 4 * found.spread[np.ix_(places, places)], found.drifts, math.inf)

    @classmethod
    def usual(cls) -> DriftRates:
        """Of robots in general."""
        return cls(USUAL, np.diag(np.full(len(USUAL), USUAL_SPREAD**2)))

    @property
    def words(self) -> str:
        """Where they come from, and how large they are."""
        origin = (
            "such as robots usually have"
            if self.seconds is None
            else (f"as windows of {self.seconds:.3g} s show it beside the noise of poses")
        )
        if self.seconds == math.inf:
            seen = "show it" if self.shown else "leave it open"
            origin = f"as whole logs {seen} beside all else that errs"
            origin = origin if np.any(self.spread) else "as the study specifies it"
        elif not self.shown and self.seconds is not None:
            seen = "do not show" if self.shown is False else "are too short to show or rule out"
            origin = f"which the logs {seen}, taken as large as the noise of poses leaves open"
        return f"drift, {origin}: {drift_in_words(self.values)}"


def drift_rates(fit: Fit) -> DriftRates | None:
    """The most likely rates at a joint fit's solution, given how large they usually are.

    None of methods that compare windows, whose errors have the drift in them, and of relative poses likewise:
    each begins where the robot is.
    """
    if fit.motions or fit.by_start is None:
        return None
    if set(fit.layout.states) != set(READ) or follows_state(fit.unknowns.robot):
        return DriftRates.usual()
    fit = _of_poses(fit)
    layout = _layout(fit)
    likelihood = _likelihood(fit, Windows(layout, fit.unknowns, fit.offsets))
    assert likelihood.prior is not None
    found = likelihood.greatest()
    odds = likelihood.surprise(found)[0] - without_drift(likelihood)[2]
    shown = drift_shows(odds)
    if not shown:
        means, spread = faint_drift(fit, layout.logs, USUAL)
        return DriftRates(means * USUAL, spread, shown, layout.seconds)
    # A drift that windows cannot show at all, of turning where there is none, is as usual.
    rates = np.where(found > 0, found, np.exp(likelihood.prior[0]))[OF_POSES:]
    return DriftRates(rates, likelihood.spread(found)[OF_POSES:, OF_POSES:], shown, layout.seconds)


def without_drift(likelihood: Likelihood) -> tuple[Likelihood, Array, float]:
    """A likelihood of poses' noise alone, its most likely variances (parts,), and -2 times its logarithm."""
    parts = likelihood.parts.copy()
    parts[-len(USUAL) :] = 0.0
    none = replace(likelihood, parts=parts)
    found = none.greatest()
    return none, found, none.surprise(found)[0]


def _of_poses(fit: Fit) -> Fit:
    # Without the constants of other sensors, which windows of poses do not depend on.
    unknowns, poses = fit.unknowns, dict(list(fit.unknowns.constants.items())[: len(PLACE)])
    kept = [at for at, name in enumerate(unknowns.names) if name in poses or name not in unknowns.constants]
    place = tuple(name for name in unknowns.place if name in poses)
    return replace(
        fit,
        unknowns=replace(unknowns, place=place, sits=unknowns.sits[: len(poses)], constants=poses),
        values=fit.values[kept],
        knowledge=fit.knowledge[np.ix_(kept, kept)],
        scores=fit.scores[:, kept],
    )


def _layout(fit: Fit) -> SegmentLayout:
    # Windows as long as whole segments that were tried are, whose functions there are already.
    logs = tuple(_without_outliers(fit, number) for number in range(len(fit.layout.logs)))
    shortest = shortest_seconds(fit.layout)
    driven = sum(float(log.pose_times[-1] - log.pose_times[0]) for log in logs)
    doublings = np.floor(np.log2(max(driven / (ENOUGH * shortest), 1.0)))
    seconds = shortest * float(min(2.0**doublings, LONGEST))
    return cut(logs, seconds, [float(fit.offsets[fit.layout.clocks.index(log.file)]) for log in logs])


def _without_outliers(fit: Fit, number: int) -> Log:
    # Poses that a robust loss gives little weight would be mistaken for drift.
    layout, log = fit.layout, fit.layout.logs[number]
    far = (fit.weights < 1) & (np.abs(fit.white) > OUTLYING)
    own = slice(len(layout.states))
    doubtful = (layout.valid & far)[..., own].any(axis=-1) & (layout.owner == number)[:, None]
    if not doubtful.any():
        return log
    kept = ~np.isin(log.pose_times, layout.times[doubtful])
    return replace(log, pose_times=log.pose_times[kept], poses=log.poses[kept])


def _likelihood(fit: Fit, windows: Windows) -> Likelihood:
    motions, layout = windows.motions(fit.values), windows.layout
    residuals, counts = averaged(windows, motions)
    sensor_heading = float(fit.unknowns.parts(fit.values)[1][PLACE.index("sensor_heading")])
    course = Course(motions.path, layout.steps, windows.linked, counts, sensor_heading)
    parts = course.parts
    # Jitter of the poses' times is averaged along with them.
    parts[TIMING] = 0.0
    scale = fit.unknowns.scale
    slopes = motions.slopes.reshape(-1, len(scale)) * scale
    # Not by the scores, which balance it only as far as the search has arrived: beside next to no knowledge
    # what is left of them would pull anywhere.
    pull = fit.knowledge @ (fit.unknowns.nominal - fit.values)
    known = fit.knowledge * np.outer(scale, scale), pull * scale
    sizes = [fit.noises[name].at_rest ** 2 for name in PARTS[:TIMING]]
    means = np.log([*sizes, sizes[0], *USUAL])
    deviations = np.array([POSE_SPREAD] * OF_POSES + [USUAL_SPREAD] * len(USUAL))
    rows = np.column_stack([residuals.ravel(), slopes])
    return Likelihood(parts, np.zeros(parts.shape[1:]), rows, known, (means, deviations))


def averaged(windows: Windows, motions: Motions) -> tuple[Array, Array]:
    """Residuals (S, 3) of motions between ends that are means of the poses around, dead reckoning carrying
    these there, and of how many poses each is the mean, (S, 2).
    """
    layout, path = windows.layout, motions.path
    rows, last = np.arange(layout.count), layout.last
    off = np.where(_read(layout)[..., None], windows.relative - path, 0.0)
    sums, counts = zip(
        *(_around(layout, path, off, node) for node in (np.zeros_like(last), last)), strict=True
    )
    total, number = np.stack(sums, axis=1), np.stack(counts, axis=1).astype(float)
    # Both windows that share a pose have poses around it.
    linked = windows.linked
    for each in (total, number):
        both = each[:-1, 1] + each[1:, 0]
        each[:-1, 1][linked] = both[linked]
        each[1:, 0][linked] = both[linked]
    mean = total / (number + 1)[..., None]
    before, after = effects_of_ends(path[rows, last])
    moved = np.einsum("sij,sj->si", before, mean[:, 0]) + np.einsum("sij,sj->si", after, mean[:, 1])
    return motions.residuals + moved, number + 1


def _read(layout: SegmentLayout) -> Bools:
    # When there is a whole pose, (S, n + 1).
    return layout.read_together(range(len(READ)))


def _around(layout: SegmentLayout, path: Array, off: Array, node: Places) -> tuple[Array, Array]:
    # Sum of how far poses around a window's end are off it, along its heading, and their number.
    rows, times = np.arange(layout.count), layout.times
    apart = np.abs(times - times[rows, node][:, None])
    near = _read(layout) & (apart <= NEAR * (times[:, -1:] - times[:, :1]) + 1e-9)
    near[rows, node] = False
    here, way = path[rows, node], path[rows, node][:, None, :2] - path[..., :2]
    x, y, turn = np.moveaxis(off, -1, 0)
    carried = np.stack([x - turn * way[..., 1], y + turn * way[..., 0], turn], axis=-1)
    total = ((carried - off[rows, node][:, None]) * near[..., None]).sum(axis=1)
    along = (total[:, 0] + 1j * total[:, 1]) * np.exp(-1j * here[:, 2])
    return np.column_stack([along.real, along.imag, total[:, 2]]), near.sum(axis=1)
