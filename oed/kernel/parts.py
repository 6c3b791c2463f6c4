"""What every single reading of a trajectory says: information that adds up, reading by reading."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.errors import ProblemError
from oed.foundation.presenting import Brief
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import jacobians
from oed.kernel.measurement.sensor import row_times
from oed.kernel.problem import Problem


@dataclass(frozen=True)
class Reading:
    """One reading.

    Attributes:
        sensor: its label.
        run: from 0.
        time: of a run [s]; of readings in periods the middle of theirs.
    """

    sensor: str
    run: int
    time: float


@dataclass(frozen=True, repr=False)
class Parts(Brief):
    """Information of readings that are independent of each other, and what is known without them.

    Attributes:
        readings: n of them.
        matrices: M of each on judged parameters, further ones and nuisances, in the criterion's scaling,
            (n, q, q).
        known: information from before, (q, q).
        judged: how many of the q are judged; the others are unknown as well.
    """

    readings: tuple[Reading, ...]
    matrices: Array
    known: Array
    judged: int

    def whole(self, weights: Array) -> Array:
        """Information on all q of readings that count so much, (q, q)."""
        return np.asarray(self.known + np.tensordot(weights, self.matrices, axes=1))

    def projection(self, weights: Array) -> Array:
        """T = [I, -F12 F22^-1], (judged, q): T F T' is what is left on the judged, the others eliminated."""
        whole, count = self.whole(weights), self.judged
        across = np.linalg.lstsq(whole[count:, count:], whole[count:, :count], rcond=None)[0].T
        return np.hstack([np.eye(count), -across])

    def information(self, weights: Array) -> Array:
        """On the judged parameters, the others eliminated, (judged, judged)."""
        back = self.projection(weights)
        return np.asarray(back @ self.whole(weights) @ back.T)


@typed
def parts_of(problem: Problem, trajectory: Trajectory) -> Parts:
    """What every reading of a trajectory says.

    Raises:
        ProblemError: a measurement whose readings do not add up: of regressions, or correlated.
        ValueError, NotFinite: as `evaluate` does.
    """
    sensors = problem.measurement.joint_sensors
    if not sensors or any(one.joint_whitening is not None for one in sensors):
        text = "its readings do not add up one by one: weights need sensors with independent readings"
        raise ProblemError.about(("measurement", "kind"), text)
    (one,), (jacobian,) = problem.any_estimations, jacobians(problem, trajectory)
    block, count = one.block, len(one.parameters)
    own = [block.parameters.index(name) for name in one.parameters]
    nuisances = range(len(block.parameters), jacobian.shape[1])
    judged = len(one.judged)
    scales = np.concatenate([one.scales, np.ones(count - judged + len(nuisances))])
    rows = jacobian[:, [*own, *nuisances]] * scales
    known = np.zeros((rows.shape[1],) * 2)
    if one.prior is not None:
        known[:count, :count] = one.prior
    known[np.diag_indices(len(known))] += [0.0] * count + [
        0.0 if nuisance.deviation is None else nuisance.deviation**-2 for nuisance in block.nuisances
    ]
    known *= np.outer(scales, scales)
    times = row_times(sensors, problem.system, trajectory.samples // trajectory.runs, trajectory.runs)
    groups = [
        (key, [row for row, _ in each]) for key, each in groupby(enumerate(times), lambda pair: pair[1])
    ]
    return Parts(
        tuple(Reading(label, run, column * trajectory.period) for (label, run, column), _ in groups),
        np.stack([rows[own].T @ rows[own] for _, own in groups]),
        known,
        judged,
    )
