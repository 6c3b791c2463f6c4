"""The robot's motion between the ends of windows, as measured and as predicted.

A window is a segment of a log of which only the first and the last pose count. The motion between them is
seen from the first measured pose: how far ahead and to the left the last one lies, and how far it is turned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from oed.estimation.methods.fit import Fit
from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.prediction.logged_readings import LoggedReadings
from oed.estimation.setup.options import Method
from oed.estimation.setup.unknowns import PLACE, Unknowns
from oed.foundation.arrays import Array, Bools
from oed.foundation.errors import ProblemError
from oed.kernel.dynamics.system import follows_state
from oed.robots.sensors.logged import Noise

READ = ("x", "y", "heading")
"""What a motion is made of: ahead and to the left [m], turn [rad]."""
SPAN = 3
"""Steps over which the velocity at a window's end is taken: one alone shows the encoders' ticks."""
TINY = 1e-9
"""Standard deviation that noise is taken to have at least [m, rad]."""


def require_windows(layout: SegmentLayout, unknowns: Unknowns, method: Method) -> None:
    """Raise ProblemError unless windows show whole motions that nothing but the inputs and the poses at their
    ends determine, and more of them than there are unknowns.

    Args:
        layout: of the logs.
        unknowns: that are fitted.
        method: that fits them, for the message.
    """
    robot = unknowns.robot
    if follows_state(robot):
        text = (
            f"{method} compares motion between poses, and the {', '.join(robot.states[3:])} that a window of "
            f"{robot.kind} begins with is not among them; use method: joint"
        )
        raise ProblemError.about(("calibration", "method"), text)
    if set(layout.quantities) != set(READ):
        text = (
            f"{method} compares motion between poses, of {', '.join(READ)} and nothing else; the logs hold "
            f"{', '.join(layout.quantities)}; use method: joint"
        )
        raise ProblemError.about(("calibration", "method"), text)
    if layout.count <= unknowns.size:
        text = (
            f"{layout.count} windows are too few for {unknowns.size} unknowns; shorten them, or method: joint"
        )
        raise ProblemError.about(("calibration", "segment"), text)


@dataclass(frozen=True)
class Motions:
    """What windows show at given unknowns.

    Attributes:
        residuals: measured less predicted motion, (S, 3).
        slopes: derivatives of the predicted motion by the unknowns, (S, 3, q).
        path: predicted poses on the way, seen from the first measured one, (S, n + 1, 3).
    """

    residuals: Array
    slopes: Array
    path: Array


@dataclass(frozen=True)
class Windows:
    """Windows of logs, and what the unknowns predict for them.

    Attributes:
        layout: a window each segment; with x, y and heading.
        unknowns: to estimate.
        offsets: of the clocks, as far as known, (clocks,) [s].
    """

    layout: SegmentLayout
    unknowns: Unknowns
    offsets: Array

    @cached_property
    def measured(self) -> Array:
        """The motion of each window, (S, 3)."""
        return np.asarray(self.relative[np.arange(self.layout.count), self.layout.last])

    @cached_property
    def relative(self) -> Array:
        """Measured poses, seen from the window's first, (S, n + 1, 3)."""
        return relative_to_first(self._poses)

    @cached_property
    def linked(self) -> Bools:
        """Whether a window begins with the pose that the one before it ends with, (S - 1,)."""
        owner, times = self.layout.owner, self.layout.times
        return np.asarray((owner[1:] == owner[:-1]) & (times[1:, 0] == times[:-1, -1]))

    def motions(self, values: Array) -> Motions:
        """Residuals and derivatives at unknowns (q,)."""
        key = values.tobytes()
        if key not in self._remembered:
            self._remembered.clear()
            self._remembered[key] = self._motions(values)
        return self._remembered[key]

    @cached_property
    def _remembered(self) -> dict[bytes, Motions]:
        # The last motions asked for: a search ends where it has been before.
        return {}

    def _motions(self, values: Array) -> Motions:
        _, place, _ = self.unknowns.parts(values)
        path, slopes, own = self._readings.derivatives(values, self._starts(place))
        # The sensor's place also moves the start that follows from the first measured pose.
        first, kept = len(self.unknowns.parameters), list(map(PLACE.index, self.unknowns.place))
        ends = slopes[:, -1].copy()
        ends[..., first : first + len(kept)] += own[:, -1, :, :3] @ _start_slopes(place)[:, kept]
        return Motions(self.measured - path[:, -1], ends, path)

    def rates(self, path: Array) -> tuple[Array, Array]:
        """Speeds [m/s] and yaw rates [rad/s], without signs, at both ends of every window, (S, 2) each."""
        ahead, left, turning = np.moveaxis(end_rates(path, self.layout.steps), -1, 0)
        return np.hypot(ahead, left), np.abs(turning)

    @cached_property
    def as_readings(self) -> SegmentLayout:
        """The windows as segments of two readings, of which the last one is the motion."""
        layout, order = self.layout, [READ.index(name) for name in self.layout.quantities]
        motions = self.measured[:, order]
        return replace(
            layout,
            times=layout.times[:, [0, -1]],
            readings=np.stack([np.zeros_like(motions), motions], axis=1),
            valid=np.tile([[False], [True]], (layout.count, 1, len(READ))),
        )

    def at_ends(self, values: Array) -> Array:
        """Values (S, 3) of the motions in the form of `as_readings`, (S, 2, quantities)."""
        order = [READ.index(name) for name in self.layout.quantities]
        own = values[:, order]
        return np.stack([np.zeros_like(own), own], axis=1)

    def fit(
        self,
        values: Array,
        *,
        white: Array,
        leverage: Array,
        **further: Any,
    ) -> Fit:
        """A solution over windows.

        Args:
            values: of the unknowns, (q,).
            white: residuals of the motions in units of their noise, (S, 3).
            leverage: share of each motion's variance that the fit takes, (S, 3).
            further: other attributes of the `Fit`.
        """
        motions = self.motions(values)
        speeds, yaw_rates = self.rates(motions.path)
        return Fit(
            unknowns=self.unknowns,
            values=values,
            offsets=self.offsets,
            starts=self.first_poses,
            layout=self.as_readings,
            residuals=self.at_ends(motions.residuals),
            white=self.at_ends(white),
            weights=self.at_ends(np.ones_like(white)),
            redundancy=self.at_ends(1 - leverage),
            speeds=speeds,
            yaw_rates=yaw_rates,
            motions=True,
            **further,
        )

    @property
    def first_poses(self) -> Array:
        """The states (S, states) that windows begin with, as measured; those that no log holds are 0."""
        others = len(self.unknowns.robot.states) - len(READ)
        return np.pad(self._poses[:, 0], ((0, 0), (0, others)))

    @property
    def _poses(self) -> Array:
        order = [self.layout.quantities.index(name) for name in READ]
        return np.asarray(self.layout.readings[..., order])

    @cached_property
    def _readings(self) -> LoggedReadings:
        return LoggedReadings(self.layout, self.unknowns, self.offsets, READ)

    def _starts(self, place: Array) -> Array:
        # Where the robot stands when its sensor is at the origin; states that no log holds begin at 0.
        start = np.zeros(len(self.unknowns.robot.states))
        arm = -(place[0] + 1j * place[1]) * np.exp(-1j * place[2])
        start[:3] = arm.real, arm.imag, -place[2]
        return np.tile(start, (self.layout.count, 1))


def relative_to_first(poses: Array) -> Array:
    """Poses (S, n, 3) relative to the first of each row, along its heading."""
    off = poses - poses[:, :1]
    across = (off[..., 0] + 1j * off[..., 1]) * np.exp(-1j * poses[:, :1, 2])
    return np.stack([across.real, across.imag, off[..., 2]], axis=-1)


def end_rates(path: Array, steps: Array) -> Array:
    """Velocity of the sensor (S, 2, 3) at both ends of windows, along its own heading there.

    Args:
        path: poses (S, n + 1, 3).
        steps: time between them, 0 beyond a window's end, (S, n) [s].
    """
    rows, last = np.arange(len(path)), (steps > 0).sum(axis=1)
    reach = np.minimum(SPAN, last)
    times = np.concatenate([np.zeros((len(path), 1)), np.cumsum(steps, axis=1)], axis=1)
    found = []
    for here, there in ((np.zeros_like(last), reach), (last, last - reach)):
        pair = np.stack([path[rows, here], path[rows, there]], axis=1)
        found.append(relative_to_first(pair)[:, 1] / (times[rows, there] - times[rows, here])[:, None])
    return np.stack(found, axis=1)


def _start_slopes(place: Array) -> Array:
    # Derivatives (3, 3) of the robot's start by the sensor's place.
    turn = np.exp(-1j * place[2])
    by_ahead, by_left = -turn, -1j * turn
    by_turn = 1j * (place[0] + 1j * place[1]) * turn
    columns = np.array([by_ahead, by_left, by_turn])
    return np.stack([columns.real, columns.imag, [0.0, 0.0, -1.0]])


def pose_variances(noises: Mapping[str, Noise], rates: tuple[Array, Array]) -> Array:
    """Variances (..., 3) of poses at speeds [m/s] and yaw rates [rad/s] (...), of noise that is specified."""
    position, heading = (noises[name].deviation(*rates) ** 2 for name in ("position", "heading"))
    return np.stack([position, position, heading], axis=-1)
