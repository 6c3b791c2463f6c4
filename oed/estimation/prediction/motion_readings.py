"""What a sensor reads of its own motions, each driven in as many parts as its duration asks for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.prediction.segments import Driven, SegmentReadings
from oed.foundation.arrays import Array
from oed.robots.models.model import Model
from oed.robots.sensors.relative_poses import RelativePoses


class Moved(NamedTuple):
    """What readings of motions depend on, SI.

    Attributes:
        starts: states of the robot at their beginnings, (S, states).
        offsets: of the clocks, (clocks,) [s].
        parameters: of the robot, (p,).
        nuisances: the sensor's own, (k,).
    """

    starts: Array
    offsets: Array
    parameters: Array
    nuisances: Array


@dataclass(frozen=True)
class MotionReadings:
    """The readings of a layout's motions, which stand at the last of each one's two times.

    Attributes:
        model: the robot.
        layout: the motions.
    """

    model: Model
    layout: SegmentLayout

    def __call__(self, moved: Moved) -> Array:
        """The readings (S, 2, q), SI."""
        return self._gathered(moved, lambda readings, driven: (readings(driven),))[0]

    def derivatives(self, moved: Moved) -> tuple[Array, Array]:
        """The readings, and their derivatives (S, 2, q, p + states + k), as of `SegmentReadings`."""
        found, slopes = self._gathered(moved, lambda readings, driven: readings.derivatives(driven))
        return found, slopes

    def _gathered(
        self, moved: Moved, read: Callable[[SegmentReadings, Driven], tuple[Array, ...]]
    ) -> list[Array]:
        # What is read of motions that are driven together, each put where it belongs.
        found = list[Array]()
        for (rows, _), each in zip(self.layout.in_parts, self._each(moved, read), strict=True):
            if not found:
                found = [np.zeros((self.layout.count, 2, *one.shape[2:])) for one in each]
            for whole, own in zip(found, each, strict=True):
                whole[rows, -1] = own[:, -1]
        return found

    def _each(
        self, moved: Moved, read: Callable[[SegmentReadings, Driven], tuple[Array, ...]]
    ) -> Iterator[tuple[Array, ...]]:
        for (rows, finer), readings in zip(self.layout.in_parts, self._readings, strict=True):
            inputs = finer.inputs(moved.offsets)
            yield read(
                readings, Driven(moved.starts[rows], inputs, finer.steps, moved.parameters, moved.nuisances)
            )

    @cached_property
    def _readings(self) -> tuple[SegmentReadings, ...]:
        return tuple(
            SegmentReadings(self.model, RelativePoses(every=finer.periods), finer.count, finer.periods)
            for _, finer in self.layout.in_parts
        )
