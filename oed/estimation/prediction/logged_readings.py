"""What is read of segments of logs, as a function of the unknowns and of the segments' starts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt

from oed.estimation.prediction.further_starts import first_starts, further_starts
from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.prediction.segments import SegmentReadings
from oed.estimation.setup.unknowns import Unknowns

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LoggedReadings:
    """The readings that unknowns predict.

    Attributes:
        layout: the segments.
        unknowns: common to them.
        offsets: of the clocks, as far as known, (clocks,) [s].
        quantities: that are read.
    """

    layout: SegmentLayout
    unknowns: Unknowns
    offsets: Array
    quantities: tuple[str, ...]

    @classmethod
    def of(cls, layout: SegmentLayout, unknowns: Unknowns, offsets: Array) -> LoggedReadings:
        """Those that the logs hold."""
        return cls(layout, unknowns, offsets, layout.quantities)

    def reading(self, *quantities: str) -> LoggedReadings:
        """Other quantities of the same drives."""
        return replace(self, quantities=quantities)

    def __call__(self, values: Array, starts: Array) -> Array:
        """The readings (S, n + 1, quantities), SI, at unknowns (q,) and starts (S, states)."""
        parameters, place, clocks = self.unknowns.parts(values)
        return self._at(starts, parameters, place, self._offsets(clocks))

    def derivatives(self, values: Array, starts: Array) -> tuple[Array, Array, Array]:
        """The readings, and their derivatives by the unknowns (S, n + 1, quantities, q) and by the segment's
        own start (S, n + 1, quantities, states).
        """
        (parameters, place, clocks), steps = self.unknowns.parts(values), self.layout.steps
        offsets = self._offsets(clocks)
        inputs = self.layout.inputs(offsets)
        found, slopes = self._segments.derivatives(starts, inputs, steps, parameters, place)
        columns, size = [self.unknowns.slopes(slopes)], len(parameters)
        if len(clocks):
            columns.append(self.layout.clock_slopes(partial(self._at, starts, parameters, place), offsets))
        # A copy: a view would keep all columns.
        return found, np.concatenate(columns, axis=-1), slopes[..., size : size + starts.shape[1]].copy()

    def first_starts(self, values: Array) -> Array:
        """Starts (S, states) near enough for a search to begin from, at unknowns (q,)."""
        parameters, place, clocks = self.unknowns.parts(values)
        robot, layout = self.unknowns.robot, self.layout
        further = further_starts(robot, layout, self._offsets(clocks), parameters)
        return first_starts(robot, layout, partial(self, values), place, further)

    def rates(self, values: Array, starts: Array, readings: Array) -> tuple[Array, Array]:
        """Speeds [m/s], 0 where positions are not read, and yaw rates [rad/s] at readings (S, n + 1, k).

        Args:
            values: of the unknowns.
            starts: start states of the segments.
            readings: of the segments, (S, n + 1, ...).
        """
        places = [index for index, name in enumerate(self.quantities) if name in ("x", "y")]
        still = np.zeros(readings.shape[:2])
        speeds = self.layout.rates(readings[..., places]) if len(places) == 2 else still
        headings = [index for index, name in enumerate(self.quantities) if name == "heading"]
        turned = readings[..., headings] if headings else self.reading("heading")(values, starts)
        return speeds, self.layout.rates(turned)

    def _at(self, starts: Array, parameters: Array, place: Array, offsets: Array) -> Array:
        inputs = self.layout.inputs(offsets)
        return self._segments(starts, inputs, self.layout.steps, parameters, place)

    def _offsets(self, clocks: Array) -> Array:
        return self.offsets + clocks if len(clocks) else self.offsets

    @cached_property
    def _segments(self) -> SegmentReadings:
        layout = self.layout
        return SegmentReadings.logged(self.unknowns.robot, self.quantities, layout.count, layout.periods)
