"""Sensors of a study that an estimate does without, and points that are read far off where they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oed.estimation.assessment.doubts import Doubt
from oed.estimation.methods.fit import Fit
from oed.estimation.setup.noise import groups, places_of
from oed.kernel.measurement.measurement import Measurement, sensors_of
from oed.kernel.measurement.readings import sensor_labels
from oed.kernel.measurement.sensor import Sensor
from oed.logs.log import Log
from oed.robots.sensors.logged import LoggedSensor
from oed.robots.sensors.relative_poses import logged_sensors

ODD_POINT = 3.0
"""How many times as far off as others a landmark is that looks like a mistake."""
ODD = (
    "{} is {:.0f} times as far off as others of its kind: is its place in the study right, and is it "
    "the one of that id?"
)


def unread(measurement: Measurement, logs: Sequence[Log]) -> list[str]:
    """Sensors of the study that the estimate knows nothing of.

    Args:
        measurement: the study's.
        logs: that were read.
    """
    sensors, read = sensors_of(measurement), {one.sensor for log in logs for one in log.sensors}
    states, logged = set(logs[0].quantities), logged_sensors(measurement, logs[0].motions is not None)
    fitted = [id(one) for one in logged if set(one.noises) & states or not one.noises]
    return [
        f"{label} is not used: the logs have no readings of it (`log: {_key(sensor)}{label}` says where they "
        "are)"
        for label, sensor in zip(sensor_labels(sensors), sensors, strict=True)
        if label not in read and id(sensor) not in fitted
    ]


def _key(sensor: Sensor) -> str:
    return "" if isinstance(sensor, LoggedSensor) else "sensors: "


def odd_points(fit: Fit) -> tuple[Doubt, ...]:
    """Points that stand elsewhere than the study has them, or are others than their ids say."""
    quantities, found = fit.layout.quantities, list[Doubt]()
    for group in groups(quantities):
        own = [place for place in places_of(group, quantities) if quantities[place].endswith("]")]
        left = np.where(fit.layout.valid, fit.residuals, 0.0)[..., own]
        counts = fit.layout.valid[..., own].sum(axis=(0, 1))
        sizes = np.sqrt((left**2).sum(axis=(0, 1)) / np.maximum(counts, 1))
        usual = float(np.median(sizes[sizes > 0])) if np.count_nonzero(sizes) > 2 else np.inf
        odd = [(quantities[place], size / usual) for place, size in zip(own, sizes, strict=True)]
        found += [Doubt("", "odd_point", ODD.format(name, share)) for name, share in odd if share > ODD_POINT]
    return tuple(found)
