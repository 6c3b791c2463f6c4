"""A skid-steer robot that slides outwards in bends, as a model of one's own beside those of the package."""

from __future__ import annotations

import casadi as ca

import oed

SOFT = 0.01
"""Yaw rate [rad/s] over which the corner of its magnitude at 0 is rounded."""


class DriftingRobot(oed.Model):
    """Two sides that turn the robot about a place of its own, and a drift that its weight causes in bends.

    Friction that holds a turning robot in its bend has to point inwards: the wheels slide outwards, at
    drift * V * Omega^2 [m/s]. For wheels that slide in every direction alike, drift is a length of the
    wheelbase's order over friction times gravity.
    """

    kind: str = "drifting_robot"
    wheel_radius: float = 0.05
    track: float = 0.3
    x_icr: float = 0.0
    y_icr: float = 0.0
    drift: float = 0.04

    inputs = (
        oed.Input("wheel_speed_right", "wheel_speed", "rad/s"),
        oed.Input("wheel_speed_left", "wheel_speed", "rad/s"),
    )

    @property
    def parameters(self):
        """Wheel radii, track, the centre of spins ahead and to the left [m], drift [s^2]."""
        return (
            oed.Parameter("wheel_radius_right", self.wheel_radius, "m"),
            oed.Parameter("wheel_radius_left", self.wheel_radius, "m"),
            oed.Parameter("track", self.track, "m"),
            oed.Parameter("x_icr", self.x_icr, "m", self.track),
            oed.Parameter("y_icr", self.y_icr, "m", self.track),
            oed.Parameter("drift", self.drift, "s^2"),
        )

    def twist(self, inputs, parameters):
        """Forward speed, lateral speed and yaw rate; what a spin does not turn about the origin moves it."""
        radius_right, radius_left, track, x_icr, y_icr, drift = ca.vertsplit(parameters)
        right, left = radius_right * inputs[0], radius_left * inputs[1]
        forward, turn = (right + left) / 2, (right - left) / track
        outwards = drift * forward * turn * ca.sqrt(turn**2 + SOFT**2)
        return ca.vertcat(forward + y_icr * turn, -x_icr * turn - outwards, turn)
