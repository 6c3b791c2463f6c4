"""A robot of one's own: a differential drive whose wheels shrink with speed, one more thing to estimate."""

from __future__ import annotations

import casadi as ca

import oed


class LoadedDrive(oed.Model):
    """Two driven wheels; their effective radius falls by `softness` [m] for every m/s of forward speed."""

    kind: str = "loaded_drive"
    wheel_radius: float = 0.05
    track: float = 0.3
    softness: float = 0.001

    inputs = (
        oed.Input("wheel_speed_right", "wheel_speed", "rad/s"),
        oed.Input("wheel_speed_left", "wheel_speed", "rad/s"),
    )

    @property
    def parameters(self):
        """wheel_radius, track [m], softness [s]."""
        return (
            oed.Parameter("wheel_radius", self.wheel_radius, "m"),
            oed.Parameter("track", self.track, "m"),
            oed.Parameter("softness", self.softness, "s"),
        )

    def twist(self, inputs, parameters):
        """Forward speed, 0, yaw rate of wheels whose radius depends on the speed."""
        radius, track, softness = parameters[0], parameters[1], parameters[2]
        mean = radius * (inputs[0] + inputs[1]) / 2
        rolling = radius - softness * ca.sqrt(mean**2 + 1e-4)
        return ca.vertcat(rolling * (inputs[0] + inputs[1]) / 2, 0, rolling * (inputs[0] - inputs[1]) / track)
