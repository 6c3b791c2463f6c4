"""Pieces of logged drives: the readings that a pose sensor makes of them, and their derivatives.

A log is cut into segments, each driven from a start of its own. All segments are computed in one call;
shorter ones are padded with periods of no time, which change nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.estimation.setup.unknowns import PLACE
from oed.kernel.dynamics.direct_call import direct_call
from oed.kernel.dynamics.rollout import carrier
from oed.kernel.measurement.sensor import LeverArm, Moment
from oed.robots.models.model import Integration, Model, step
from oed.robots.sensors.poses import Poses

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SegmentReadings:
    """What segments with given inputs read.

    Attributes:
        model: the robot.
        integration: rule by which its poses follow from its twist.
        quantities: what is read at every time: states of the robot, x, y and heading at the sensor's place.
        count: S, segments.
        periods: n, of the longest of them.
    """

    model: Model
    integration: Integration
    quantities: tuple[str, ...]
    count: int
    periods: int

    def __call__(self, starts: Array, inputs: Array, times: Array, parameters: Array, place: Array) -> Array:
        """The readings (S, n + 1, quantities), SI.

        Args:
            starts: states at the segments' beginnings, (S, states).
            inputs: held in each period, (S, n, inputs).
            times: lengths of the periods [s], 0 beyond a segment's end, (S, n).
            parameters: (p,), SI.
            place: of the sensor: ahead, to the left [m], turned [rad], (3,).
        """
        (found,) = direct_call(self._plain, starts, inputs, times, parameters, place)
        return self._by_segment(found)

    def derivatives(
        self, starts: Array, inputs: Array, times: Array, parameters: Array, place: Array
    ) -> tuple[Array, Array]:
        """The readings, and their derivatives (S, n + 1, quantities, p + states + 3).

        The columns are the parameters, the segment's own start, the sensor's place.
        """
        found, slopes = direct_call(self._both, starts, inputs, times, parameters, place)
        width = len(self.model.parameters) + len(self.model.states) + len(PLACE)
        return self._by_segment(found), self._by_segment(slopes, width)

    def _by_segment(self, found: Array, *width: int) -> Array:
        return found.reshape(self.count, self.periods + 1, len(self.quantities), *width)

    @cached_property
    def _plain(self) -> ca.Function:
        function = _segment(self.model, self.integration, self.quantities, self.periods, slopes=False)
        return _mapped(function, self.count)

    @cached_property
    def _both(self) -> ca.Function:
        function = _segment(self.model, self.integration, self.quantities, self.periods, slopes=True)
        return _mapped(function, self.count)


def _mapped(function: ca.Function, count: int) -> ca.Function:
    # Parameters and place are common to all segments.
    return function.map("segments", "serial", count, [3, 4], []) if count > 1 else function


@lru_cache(maxsize=32)
def _segment(
    model: Model, integration: Integration, quantities: tuple[str, ...], periods: int, *, slopes: bool
) -> ca.Function:
    states, size = len(model.states), len(model.parameters)
    start, parameters = ca.MX.sym("start", states), ca.MX.sym("p", size)
    inputs, times = ca.MX.sym("inputs", len(model.inputs), periods), ca.MX.sym("times", 1, periods)
    place = ca.MX.sym("place", len(PLACE))
    arguments = [start, inputs, times, parameters, place]
    repeated = ca.repmat(parameters, 1, periods)
    following = step(model, integration).mapaccum(periods)(start, inputs, repeated, times)
    poses = ca.horzcat(start, following)
    everywhere = ca.repmat(place, 1, periods + 1)
    if not slopes:
        read = ca.densify(_reading(model, quantities).map(periods + 1)(poses, everywhere))
        return ca.Function("readings", arguments, [read])
    begin = ca.horzcat(ca.DM(states, size), ca.DM.eye(states))
    carry = carrier(model, integration).mapaccum(periods)
    carried = ca.horzcat(begin, carry(begin, poses[:, :periods], inputs, repeated, times))
    both = _slopes(model, quantities).map(periods + 1)(poses, everywhere, carried)
    return ca.Function("readings", arguments, list(both))


@lru_cache(maxsize=32)
def _reading(model: Model, quantities: tuple[str, ...]) -> ca.Function:
    pose, place = ca.SX.sym("pose", len(model.states)), ca.SX.sym("place", len(PLACE))
    sensor = Poses(lever_arm=LeverArm(known=False))
    own = {"lever_arm.x": place[0], "lever_arm.y": place[1]}
    x, y = sensor.position(Moment(pose, ca.SX(0, 1), ca.SX(3, 1), own))
    read = dict(zip(model.states, ca.vertsplit(pose), strict=True))
    read |= {"x": x, "y": y, "heading": pose[2] + place[2]}
    return ca.Function("reading", [pose, place], [ca.vertcat(*(read[name] for name in quantities))])


@lru_cache(maxsize=32)
def _slopes(model: Model, quantities: tuple[str, ...]) -> ca.Function:
    # Derivatives row by row: by the parameters and the start through the pose, by the place directly.
    states, size = len(model.states), len(model.parameters)
    pose, place = ca.SX.sym("pose", states), ca.SX.sym("place", len(PLACE))
    carried = ca.SX.sym("S", states, size + states)
    read = _reading(model, quantities)(pose, place)
    through, direct = ca.jacobian(read, pose) @ carried, ca.jacobian(read, place)
    rows = ca.densify(ca.horzcat(through, direct))
    return ca.Function("slopes", [pose, place, carried], [read, ca.vec(rows.T)])
