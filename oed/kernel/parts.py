"""What every single reading of a trajectory says: information that adds up, reading by reading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.errors import ProblemError, UserMistake
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

    def as_rates(self, periods: int = 1) -> Parts:
        """Information of readings that are taken all the time, with as much of it a second as one reading at
        the samples has: of every so many periods together, the integral by the trapezoidal rule.

        Their weights are shares of that time.

        Args:
            periods: that have one weight in common; a divisor of those of a run.

        Raises:
            UserMistake: no divisor.
        """
        readings, matrices = list[Reading](), list[Array]()
        each = {(one.sensor, one.run): list[int]() for one in self.readings}
        for place, one in enumerate(self.readings):
            each[one.sensor, one.run].append(place)
        for (sensor, run), places in each.items():
            times, own = np.array([self.readings[one].time for one in places]), self.matrices[places]
            steps = np.diff(times)
            if len(steps) % periods or not len(steps):
                raise UserMistake(f"periods: expected a divisor of {len(steps)}, got {periods}")
            integrals = steps[:, None, None] * (own[1:] + own[:-1]) / 2
            matrices += list(integrals.reshape(-1, periods, *own.shape[1:]).sum(axis=1))
            middles = (times[:-1:periods] + times[periods::periods]) / 2
            readings += [Reading(sensor, run, float(one)) for one in middles]
        return replace(self, readings=tuple(readings), matrices=np.stack(matrices))

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


@dataclass(frozen=True)
class Budget:
    """Weights of some readings, each from 0 to `most`, that are `total` together.

    Attributes:
        places: of these readings among all.
        total: above 0, and at most as much as they can be.
        most: of each.
    """

    places: tuple[int, ...]
    total: float
    most: float = 1.0

    @property
    def even(self) -> float:
        """What each counts where all count alike."""
        return self.total / len(self.places)

    def largest(self, values: Array) -> float:
        """The largest sum of values of all readings, (n,), weighted so: a linear program, by sorting."""
        own = np.sort(values[list(self.places)])[::-1]
        return float(np.clip(self.total - self.most * np.arange(len(own)), 0.0, self.most) @ own)


@typed
def budgets_of(parts: Parts, totals: float | Mapping[str, float], most: float = 1.0) -> tuple[Budget, ...]:
    """One budget for all readings, or one for those of every sensor.

    Args:
        parts: with the readings.
        totals: of the weights, all together or by the sensors' labels.
        most: of each weight.

    Raises:
        UserMistake: a total that no such weights have, a sensor that reads nothing, or one without a total.
    """
    each = {"": list(range(len(parts.readings)))}
    if isinstance(totals, Mapping):
        each = {one.sensor: [] for one in parts.readings}
        for place, one in enumerate(parts.readings):
            each[one.sensor].append(place)
    given = dict(totals) if isinstance(totals, Mapping) else {"": totals}
    if set(given) != set(each):
        raise UserMistake(f"totals: expected one of each of {', '.join(each)}, got {', '.join(given)}")
    for name, places in each.items():
        if not 0 < given[name] <= most * len(places):
            of = f" of {name}" if name else ""
            text = f"expected a total{of} above 0 and at most {most * len(places):g}, got {given[name]:g}"
            raise UserMistake(text)
    return tuple(Budget(tuple(places), given[name], most) for name, places in each.items())


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
