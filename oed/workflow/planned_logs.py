"""Logs of a drive as it is planned: what sensors will read of it, as often as they did so far, and without
any error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from oed.estimation.methods.windows import READ
from oed.estimation.prediction.grids import TOGETHER
from oed.estimation.prediction.layout import cut
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.prediction.segments import Labelled, nuisances_of
from oed.estimation.setup.unknowns import Unknowns
from oed.foundation.arrays import Array
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.measurement import Measurement
from oed.kernel.measurement.sensor import Sensor
from oed.logs.log import Log, SensorReadings
from oed.logs.sensors import Clock, labelled
from oed.records.record import EstimateRecord
from oed.robots.models.model import Model
from oed.robots.sensors.mounting import PLACE as UNITS

MOST = 4000
"""Readings of the next drive that are looked at, at most, of poses and of each other sensor."""


@dataclass(frozen=True)
class Rhythm:
    """How a sensor reads.

    Attributes:
        step: time between readings, about [s].
        shares: of the readings that have each entry, (q,).
        clock: whose clock its times are on.
    """

    step: float
    shares: Array
    clock: Clock


@dataclass(frozen=True)
class Logging:
    """What logs of a robot hold, and how often.

    Attributes:
        step: time between poses, about [s]; without poses that between times at which anything is read.
        quantities: the states that are read; () without poses.
        sensors: that read beside them, by their names.
        rhythms: of each of these.
    """

    step: float
    quantities: tuple[str, ...] = READ
    sensors: Labelled = ()
    rhythms: tuple[Rhythm, ...] = ()

    @classmethod
    def of(cls, found: EstimateRecord, measurement: Measurement, seconds: float) -> Logging:
        """As the logs of an estimate were taken.

        Args:
            found: the estimate.
            measurement: of the study.
            seconds: of all that is planned: of a long drive less is looked at.
        """
        logged, shortest = sum(one.seconds or 0.0 for one in found.logs), seconds / MOST

        def step(readings: int) -> float:
            return max(logged / max(readings, 1), shortest)

        kept, rhythms = list[tuple[str, Sensor]](), list[Rhythm]()
        for name, sensor in labelled(measurement).items():
            each = [one for log in found.logs for one in log.sensors if one.sensor == name]
            if each:
                readings = sum(one.readings for one in each)
                shares = np.sum([one.entries for one in each], axis=0) / max(readings, 1)
                kept.append((name, sensor))
                rhythms.append(Rhythm(step(readings), shares, each[0].clock))
        quantities = found.logs[0].quantities
        poses = step(sum(one.poses or 0 for one in found.logs))
        return cls(poses, READ if quantities is None else tuple(quantities), tuple(kept), tuple(rhythms))

    def of_drive(self, robot: Model, trajectory: Trajectory) -> tuple[Log, ...]:
        """Logs of a drive as it is planned, run by run, without any error.

        Args:
            robot: at the parameters that it has.
            trajectory: of all runs.
        """
        return tuple(
            self._of_run(robot, run, f"run {number}") for number, run in enumerate(trajectory.each, 1)
        )

    def _of_run(self, robot: Model, run: Trajectory, name: str) -> Log:
        clock: Array = np.linspace(0.0, run.duration, len(run.inputs) + 1)
        turned = np.vstack([np.zeros((1, run.inputs.shape[1])), np.cumsum(run.inputs * run.period, axis=0)])
        times = _times(clock[-1], self.step)
        read = [self._read(place, clock[-1]) for place in range(len(self.sensors))]
        poses = np.zeros((len(times), len(self.quantities)))
        log = Log(name, name, clock, turned, times, poses, self.quantities, sensors=tuple(read))
        return self._driven(log, robot, run.start)

    def _read(self, place: int, seconds: float) -> SensorReadings:
        # When each entry is read; the readings themselves are 0.
        (name, _), rhythm = self.sensors[place], self.rhythms[place]
        times = _times(seconds, rhythm.step)
        # Spread evenly, where one is not always read.
        number = np.arange(len(times))[:, None]
        there = np.floor((number + 1) * rhythm.shares + TOGETHER) > np.floor(
            number * rhythm.shares + TOGETHER
        )
        values, some = np.where(there, 0.0, math.nan), there.any(axis=1)
        return SensorReadings(name, times[some], values[some], rhythm.clock)

    def _driven(self, log: Log, robot: Model, start: Array) -> Log:
        # With what is read of the drive; of a period what is read in that of the grid.
        layout = cut([log], math.inf, [0.0], self.sensors)
        own = nuisances_of(self.sensors)
        unknowns = Unknowns(
            robot,
            (),
            (),
            0,
            sits=(*[0.0] * len(UNITS), *(one.nominal for one in own)),
            constants={**UNITS, **{one.name: one.unit for one in own}},
        )
        found = LoggedReadings.of(layout, unknowns, np.zeros(1))(np.zeros(0), np.reshape(start, (1, -1)))[0]

        def at(times: Array) -> Array:
            return np.asarray(found[np.searchsorted(layout.times[0], times + TOGETHER, side="right") - 1])

        columns = np.cumsum([len(self.quantities), *(len(one.entries) for _, one in self.sensors)])
        read = [
            replace(one, values=one.values + at(one.times)[:, first:last])
            for one, first, last in zip(log.sensors, columns[:-1], columns[1:], strict=True)
        ]
        return replace(log, poses=at(log.pose_times)[:, : columns[0]], sensors=tuple(read))


def _times(seconds: float, step: float) -> Array:
    return np.linspace(0.0, seconds, max(1, round(seconds / step)) + 1)
