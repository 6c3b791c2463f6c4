"""Differential drives, without slip: tracked at the middle of their axle, beside it, or pulling a trailer."""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.quantities import Length
from oed.kernel.dynamics.expression import Expression
from oed.robots.models.wheels import Constant, PositiveLength, TwoSidedRobot

SMALL = 0.05
"""(rate * time)^2 below which series stand for hyperbolic functions."""


class DifferentialDrive(TwoSidedRobot):
    """Two driven wheels at distance `track` [m]; parameters wheel_radius_right, wheel_radius_left, track."""

    kind: Literal["differential_drive"] = "differential_drive"


class OffsetDrive(TwoSidedRobot):
    """Two driven wheels, tracked at a point `sensor_offset` [m] to the left of the middle of their axle.

    That point's forward speed is V - Omega * offset: all four coefficients are independent of each other,
    so linear least squares identifies radii, track and offset.
    """

    kind: Literal["offset_drive"] = "offset_drive"
    sensor_offset: Length = 0.0
    constants: ClassVar[tuple[Constant, ...]] = (Constant("sensor_offset", "m", size="track"),)

    def coefficients(self, parameters: Expression) -> Expression:
        """C (2, 2): the paper's, its forward row less `sensor_offset` times the yaw row."""
        centre = super().coefficients(parameters)
        return ca.vertcat(centre[0, :], centre[1, :] - parameters[3] * centre[0, :])


class TractorTrailer(TwoSidedRobot):
    """A differential drive with a trailer hitched `hitch_offset` [m] behind its axle.

    `trailer_length` [m] is from the hitch to the trailer's axle. The state `trailer_angle` [rad] is the
    trailer's heading relative to the tractor's: 0 straight behind, positive to the left.
    [Altafini, Some properties of the general n-trailer, 2001]
    """

    kind: Literal["tractor_trailer"] = "tractor_trailer"
    hitch_offset: Length = 0.0
    trailer_length: PositiveLength
    states: ClassVar[tuple[str, ...]] = ("x", "y", "heading", "trailer_angle")
    state_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad", "rad")
    constants: ClassVar[tuple[Constant, ...]] = (
        Constant("hitch_offset", "m", size="trailer_length"),
        Constant("trailer_length", "m"),
    )

    @property
    def towed(self) -> tuple[float, float]:
        """From its axle back to the hitch, and from there to the trailer's axle [m]."""
        return self.hitch_offset, self.trailer_length

    def body(self, states: Array) -> Array:
        """The hitch and the trailer's axle, (n, 2, 2) [m]."""
        x, y, heading, angle = states[:, :4].T
        origin, along = np.column_stack([x, y]), heading + angle
        hitch = origin - self.hitch_offset * np.column_stack([np.cos(heading), np.sin(heading)])
        axle = hitch - self.trailer_length * np.column_stack([np.cos(along), np.sin(along)])
        return np.stack([hitch, axle], axis=1)

    def internal_step(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The trailer angle psi after a constant twist, exactly.

        psi' = a + b cos psi + c sin psi is a Riccati equation of e^(j psi), so a sample is a Moebius map of
        the unit circle: e^(j psi) moves as the ratio of two numbers that follow a linear equation.
        """
        offset, length, angle = parameters[3], parameters[4], state[3]
        a, b, c = -twist[2], -offset * twist[2] / length, -twist[0] / length
        cosine, sine = ca.cos(angle), ca.sin(angle)
        even, odd = _hyperbolic((b**2 + c**2 - a**2) / 4, period)
        along, rate = c * cosine - b * sine, a + b * cosine + c * sine
        return angle + 2 * ca.atan2(odd * rate / 2, even - odd * along / 2)


def _hyperbolic(square: Expression, period: Expression) -> tuple[Expression, Expression]:
    # cosh(m T) and sinh(m T) / m of m^2 = square, which may be negative, by series near 0.
    reach = square * period**2
    small, positive = ca.fabs(reach) < SMALL, reach > 0
    root = ca.sqrt(ca.if_else(small, 1.0, ca.fabs(reach)))
    even = ca.if_else(positive, ca.cosh(ca.if_else(positive, root, 1.0)), ca.cos(root))
    odd = ca.if_else(positive, ca.sinh(ca.if_else(positive, root, 1.0)), ca.sin(root)) / root
    even_series = 1 + reach / 2 * (1 + reach / 12 * (1 + reach / 30 * (1 + reach / 56 * (1 + reach / 90))))
    odd_series = 1 + reach / 6 * (1 + reach / 20 * (1 + reach / 42 * (1 + reach / 72 * (1 + reach / 110))))
    return ca.if_else(small, even_series, even), period * ca.if_else(small, odd_series, odd)
