"""Information of every single reading of a trajectory, which adds up reading by reading."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import ROUNDING, Array, Places
from oed.foundation.errors import UserMistake
from oed.foundation.presenting import Brief
from oed.kernel.dynamics.system import System
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.readings import reader, sensor_labels
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.measurement.square_root import SquareRoot


@dataclass(frozen=True)
class Reading:
    """One reading.

    Attributes:
        sensor: label of the sensor.
        run: place of the run, from 0.
        time: time in the run [s]; of readings in periods the middle of the period.
    """

    sensor: str
    run: int
    time: float


@dataclass(frozen=True, repr=False)
class Parts(Brief):
    """Information of readings that are independent of each other, and what is known without them.

    Attributes:
        readings: n of them, or of groups of them.
        rows: whitened readings: derivatives by the judged parameters in the criterion's scaling, and by
            combinations of all other unknowns, (k, q).
        places: place of every row's reading, (k,).
        known_rows: square root of the information had before, in the same columns, (m, q).
        judged: number of the q columns that are judged; the others are unknown as well.
        sizes: amount of a budget that each takes at a weight of 1: one reading, or the seconds of one that is
            taken all the time, (n,).
        members: places of each part's readings among all that there are.
        rounding: possible rounding of each column of the rows, as a share of it, (q,); () where they are
            derivatives as they are.
    """

    readings: tuple[Reading, ...]
    rows: Array
    places: Places
    known_rows: Array
    judged: int
    sizes: Array
    members: tuple[tuple[int, ...], ...]
    rounding: Array | tuple[()] = ()

    @cached_property
    def known(self) -> Array:
        """Information from before, (q, q)."""
        return np.asarray(self.known_rows.T @ self.known_rows)

    def taken(self, weights: Array, free: Places) -> Parts:
        """Return the parts of some readings, when others, or they themselves, are taken surely: that is known
        then.

        Args:
            weights: weights that are taken, of all, (n,).
            free: places of the readings that are left.
        """
        number = np.full(len(self.readings), -1)
        number[free] = np.arange(len(free))
        remaining = number[self.places] >= 0
        return replace(
            self,
            readings=tuple(self.readings[place] for place in free),
            rows=self.rows[remaining],
            places=number[self.places[remaining]],
            known_rows=self._weighted(weights),
            sizes=self.sizes[free],
            members=tuple(self.members[place] for place in free),
        )

    def _weighted(self, weights: Array) -> Array:
        # The rows of what readings that count so much say together, and of what is known.
        roots = np.sqrt(weights)[self.places]
        some = roots > 0
        return np.vstack([roots[some, None] * self.rows[some], self.known_rows])

    def divided(self, pieces: int) -> Parts:
        """So many equal pieces of what every sensor reads in a run, each with one weight.

        Raises:
            UserMistake: no divisor of how many readings these are.
        """
        groups = list[list[int]]()
        for places in self.grouped(lambda reading: (reading.sensor, reading.run)).values():
            if len(places) % pieces:
                name = self.readings[places[0]].sensor
                text = f"pieces: expected a divisor of the {len(places)} readings of {name} in a trial"
                raise UserMistake(f"{text}, got {pieces}")
            groups += np.reshape(places, (pieces, -1)).tolist()
        return self._merged(groups)

    def by_run(self) -> Parts:
        """All readings of a run together, each run of size 1: how often is it to be repeated?"""
        merged = self._merged([*self.grouped(lambda reading: reading.run).values()])
        return replace(merged, sizes=np.ones(len(merged.readings)))

    def grouped(self, key: Callable[[Reading], Any]) -> dict[Any, list[int]]:
        """Return the places of the readings by what `key` returns of them."""
        groups = dict[Any, list[int]]()
        for place, reading in enumerate(self.readings):
            groups.setdefault(key(reading), []).append(place)
        return groups

    def _merged(self, groups: Sequence[Sequence[int]]) -> Parts:
        first = [self.readings[group[0]] for group in groups]
        times = [float(np.mean([self.readings[place].time for place in group])) for group in groups]
        one_run = all(len({self.readings[place].sensor for place in group}) > 1 for group in groups)
        number = np.empty(len(self.readings), dtype=int)
        for at, group in enumerate(groups):
            number[list(group)] = at
        return replace(
            self,
            readings=tuple(
                replace(reading, time=time, sensor="" if one_run else reading.sensor)
                for reading, time in zip(first, times, strict=True)
            ),
            places=number[self.places],
            sizes=np.array([self.sizes[list(group)].sum() for group in groups]),
            members=tuple(tuple(at for place in group for at in self.members[place]) for group in groups),
        )

    def of_every_reading(self, weights: Array) -> Array:
        """Weights of these, (n,), for each of the readings that they are made of."""
        spread = np.empty(sum(map(len, self.members)))
        for places, weight in zip(self.members, weights, strict=True):
            spread[list(places)] = weight
        return spread

    def whole(self, weights: Array) -> Array:
        """Information on all q of readings that count so much, (q, q)."""
        rows = self._weighted(weights)
        return np.asarray(rows.T @ rows)

    def projection(self, weights: Array) -> Array:
        """T = [I, -F12 F22^-1], (judged, q): T F T' is what is left on the judged, the others eliminated."""
        information, count = self.whole(weights), self.judged
        # In units in which each is of size 1: what is in small units is not taken for rounding.
        sizes = np.sqrt(np.diag(information)[count:])
        sizes[sizes == 0] = 1.0
        nuisances = information[count:, count:] / np.outer(sizes, sizes)
        across = (
            np.linalg.lstsq(nuisances, information[count:, :count] / sizes[:, None], rcond=None)[0].T / sizes
        )
        return np.hstack([np.eye(count), -across])

    def information(self, weights: Array) -> Array:
        """Return the information on the judged parameters, the others eliminated, (judged, judged)."""
        back = self.projection(weights)
        return np.asarray(back @ self.whole(weights) @ back.T)

    def root(self, weights: Array) -> SquareRoot:
        """`information` by its square root, which knows rounding from what is identifiable."""
        rows = self._weighted(weights)
        if not len(self.rounding):
            return SquareRoot.of_rows(rows).leading(self.judged)
        least, sizes = np.min(self.rounding), np.linalg.norm(rows, axis=0)
        sizes *= np.divide(self.rounding, least)
        return SquareRoot.of_rows(rows, sizes, float(least)).leading(self.judged)


@dataclass(frozen=True)
class Budget:
    """Weights of some readings, each from 0 to `most`, of which so much is taken together.

    Attributes:
        places: places of these readings among all.
        sizes: amount of the total that each takes at a weight of 1.
        total: above 0, and at most as much as they can be.
        most: weight of each.
        tops: largest weight of each by itself; () for `most`.
    """

    places: tuple[int, ...]
    sizes: tuple[float, ...]
    total: float
    most: float = 1.0
    tops: tuple[float, ...] = ()

    @property
    def upper(self) -> Array:
        """The largest weight of each."""
        return np.array(self.tops or (self.most,) * len(self.places))

    @property
    def even(self) -> float:
        """The share of the largest weights that is the total."""
        return self.total / float(np.array(self.sizes) @ self.upper)

    @property
    def whole(self) -> int | None:
        """Number of whole weights that are the total; None where they are not all of one size, or not so
        many.
        """
        count = self.total / self.sizes[0]
        equal = np.ptp(self.sizes) <= ROUNDING * self.sizes[0]
        near = abs(count - round(count)) <= ROUNDING * max(count, 1.0) and self.most % 1 == 0
        return round(count) if equal and near and round(count) > 0 else None

    def spent(self, weights: Array) -> float:
        """Return the amount of the budget that weights of all readings take."""
        return float(weights[list(self.places)] @ np.array(self.sizes))

    def largest(self, values: Array) -> float:
        """The largest sum of values of all readings, (n,), weighted so: a linear program, by sorting."""
        limited, sizes, upper = values[list(self.places)], np.array(self.sizes), self.upper
        order = np.argsort(-limited / sizes, kind="stable")
        sizes, upper = sizes[order], upper[order]
        spared = np.clip((self.total - np.cumsum(sizes * upper)) / sizes, -upper, 0.0)
        return float((spared + upper) @ limited[order])


@dataclass(frozen=True)
class Cost:
    """A weighted sum of all weights, and the most that it may be.

    Attributes:
        sizes: cost of each weight of 1, (n,).
        most: upper bound on the cost of all weights together.
    """

    sizes: tuple[float, ...]
    most: float

    def spent(self, weights: Array) -> float:
        """Return the cost of weights of all readings, (n,)."""
        return float(np.array(self.sizes) @ weights)


@typed
def budgets_of(parts: Parts, totals: float | Mapping[str, float], most: float = 1.0) -> tuple[Budget, ...]:
    """One budget for all readings, or one for those of every sensor.

    Args:
        parts: parts of the readings.
        totals: totals of the weights times the sizes, all together or by the sensors' labels.
        most: upper bound on each weight.

    Raises:
        UserMistake: a total that no such weights have, a sensor that reads nothing, or one without a total.
    """
    by_sensor = isinstance(totals, Mapping)
    groups = parts.grouped(lambda reading: reading.sensor if by_sensor else "")
    amounts = dict(totals) if isinstance(totals, Mapping) else {"": totals}
    if set(amounts) != set(groups):
        raise UserMistake(f"totals: expected one of each of {', '.join(groups)}, got {', '.join(amounts)}")
    for name, places in groups.items():
        largest = most * float(parts.sizes[places].sum())
        if not 0 < amounts[name] <= largest * (1 + ROUNDING):
            of = f" of {name}" if name else ""
            raise UserMistake(f"expected a total{of} above 0 and at most {largest:g}, got {amounts[name]:g}")
    return tuple(
        Budget(tuple(places), tuple(parts.sizes[places].tolist()), amounts[name], most)
        for name, places in groups.items()
    )


def laid_out(sensors: Sequence[Sensor], system: System, samples: int, runs: int, period: float) -> Parts:
    """Return the readings that sensors take, and every row's reading, before anything is known of them.

    Args:
        sensors: sensors that read.
        system: system that is read.
        samples: number of samples of each run.
        runs: number of runs.
        period: T [s].
    """
    readings, sizes, places = list[Reading](), list[float](), list[int]()
    for sensor, label in zip(sensors, sensor_labels(sensors), strict=True):
        rows, middle = reader(sensor, system).size1_out(0), 0.5 if sensor.when == "in periods" else 0.0
        for run in range(runs):
            for column in sensor.columns(samples):
                places += [len(readings)] * rows
                readings.append(Reading(label, run, (column + middle) * period))
                sizes.append(period if sensor.continuous else 1.0)
    return Parts(
        readings=tuple(readings),
        rows=np.zeros((0, 0)),
        places=np.array(places, dtype=int),
        known_rows=np.zeros((0, 0)),
        judged=0,
        sizes=np.array(sizes),
        members=tuple((place,) for place in range(len(readings))),
    )


def taken_of(sensors: Sequence[Sensor], system: System, trajectory: Trajectory) -> Parts:
    """Return the readings that sensors take of a trajectory; see `laid_out`.

    Args:
        sensors: sensors that read.
        system: system that is read.
        trajectory: the trajectory.
    """
    samples = trajectory.samples // trajectory.runs
    return laid_out(sensors, system, samples, trajectory.runs, trajectory.period)


def root_weights(sensors: Sequence[Sensor], system: System, trajectory: Trajectory) -> Array | None:
    """Return the roots of a trajectory's weights by rows of all sensors' readings, (rows,); None without any.

    Args:
        sensors: sensors that read.
        system: system that is read.
        trajectory: trajectory with the weights.

    Raises:
        ValueError: weights of another number of readings.
    """
    if trajectory.weights is None:
        return None
    count, parts = len(trajectory.weights), taken_of(sensors, system, trajectory)
    if count != len(parts.readings):
        expected = f"{len(parts.readings)} readings" if sensors else "no readings"
        raise ValueError(f"expected weights of {expected}, got {count}")
    return np.asarray(np.sqrt(trajectory.weights)[parts.places])
