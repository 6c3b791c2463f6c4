"""What a study's measurement says of the pose sensor: its noise, and where on the robot it sits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from oed.estimation.setup.noise import Noise, group_of
from oed.kernel.measurement.measurement import Measurement
from oed.robots.sensors.poses import Poses
from oed.robots.sensors.several import sensors_of


@dataclass(frozen=True)
class Mount:
    """Where the pose sensor sits, as far as the study says.

    Attributes:
        sits: ahead, to the left [m], turned [rad].
        fixed: whether ahead and to the left are known, and not to be estimated.
        deviations: what is known of places that are estimated [m].
    """

    sits: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fixed: bool = False
    deviations: Mapping[str, float] = field(default_factory=dict)


def stated_mount(measurement: Measurement) -> Mount:
    """Where the measurement's first sensor of poses sits.

    A lever arm of 0 is one that nobody gave: it is estimated, for a sensor seldom sits where it should.
    """
    arms = [one.lever_arm for one in sensors_of(measurement) if isinstance(one, Poses)]
    if not arms:
        return Mount()
    arm = arms[0]
    known = dict.fromkeys(("sensor_x", "sensor_y"), arm.deviation) if arm.deviation is not None else {}
    return Mount(
        (arm.x, arm.y, 0.0),
        arm.known and bool(arm.x or arm.y),
        {name: size for name, size in known.items() if size},
    )


def stated_noise(measurement: Measurement, averaged: int = 1) -> dict[str, Noise]:
    """The noise of absolute poses that a measurement states, by kind of reading; of x and y the larger.

    Means of `averaged` poses, whose noise is independent, have that much less.
    """
    found: dict[str, Noise] = {}
    for sensor in sensors_of(measurement):
        if not isinstance(sensor, Poses) or sensor.noise.covariance is not None:
            continue
        for quantity in sensor.quantities:
            size, group = sensor.noise.deviation(quantity), group_of(quantity)
            if size is not None and (group not in found or found[group].at_rest < size):
                growth = sensor.noise.per_speed(quantity), sensor.noise.per_yaw_rate(quantity)
                found[group] = Noise(size, *growth)
    return {group: noise.divided(math.sqrt(averaged)) for group, noise in found.items()}
