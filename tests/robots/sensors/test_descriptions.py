"""Sensors in words: what they read, when, how noisily and from where; those of the user's own as well."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import pytest
from sensors import SAMPLES, SENSOR_EXAMPLES

from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.sensor import Moment, Sensor
from oed.robots.sensors import (
    SENSORS,
    Displacements,
    Landmarks,
    Poses,
    Ranges,
    RelativePoses,
    Several,
    Tags,
    TrailerAngle,
    YawRate,
)
from oed.robots.sensors.placed import PlacedSensor


class Compass(Sensor):
    """A sensor of the user's own that says no more than it must."""

    kind: Literal["compass"] = "compass"
    noise: float = 0.05

    def reading(self, moment: Moment) -> Expression:
        """The heading."""
        return moment.pose[2]

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma."""
        return ca.SX(1 / self.noise)


class Doppler(PlacedSensor):
    """One that says its units, reads in periods, and whose noise depends on the drive."""

    kind: Literal["doppler"] = "doppler"
    when: ClassVar[Literal["at samples", "in periods"]] = "in periods"

    @property
    def subject(self) -> str:
        """A speed."""
        return "the speed over ground"

    def reading(self, moment: Moment) -> Expression:
        """The forward speed."""
        return moment.twist[0]

    def whitening(self, moment: Moment) -> Expression:
        """Less precise the faster it is."""
        return 1 / (0.01 + 0.1 * ca.fabs(moment.twist[0]))


class Pair(Compass):
    """Two readings whose errors are alike."""

    correlated: bool = True

    @property
    def units(self) -> tuple[str, ...]:
        """An angle and a distance."""
        return ("rad", "m")

    def whitening(self, moment: Moment) -> Expression:
        """Of the standard deviations 2 deg and 30 mm."""
        covariance = ca.diag(ca.DM([math.radians(2) ** 2, 0.03**2]))
        if self.correlated:
            covariance[0, 1] = covariance[1, 0] = 0.5 * math.radians(2) * 0.03
        return ca.SX(ca.inv(ca.chol(covariance).T))


class Drifting(Pair):
    """Three readings whose errors are alike over time."""

    every: int = 10

    @property
    def units(self) -> tuple[str, ...]:
        """An angle."""
        return ("rad",)

    @property
    def joint_whitening(self) -> np.ndarray:
        """Of the standard deviation 2 deg, half of its variance common to all."""
        covariance = math.radians(2) ** 2 * (0.5 * np.eye(3) + 0.5)
        return np.linalg.inv(np.linalg.cholesky(covariance))


def test_every_sensor_says_when_it_reads_and_how_noisily():
    for example in SENSOR_EXAMPLES:
        text, times = example.sensor.sentence(SAMPLES), len(example.moments(SAMPLES))
        unit = "period" if example.periods else "sample"
        assert f"({times} time{'s' if times > 1 else ''})" in text, example.name
        assert f" {unit} (" in text, example.name
        assert "standard deviation" in text, example.name
        assert str(times) in example.sensor.brief(SAMPLES), example.name


def test_every_kind_is_among_the_examples():
    assert {type(example.sensor) for example in SENSOR_EXAMPLES} == set(SENSORS)


@pytest.mark.parametrize(
    ("sensor", "brief", "sentence"),
    [
        (
            TrailerAngle(noise=math.radians(0.5), every=2),
            "11 trailer angles",
            "the trailer's angle at every 2nd sample (11 times) with a standard deviation of 0.5 deg "
            "and no bias",
        ),
        (
            TrailerAngle(noise=0.01, bias="unknown"),
            "21 trailer angles",
            "the trailer's angle at every sample (21 times) with a standard deviation of 0.573 deg",
        ),
        (
            YawRate(noise=math.radians(1), bias="known"),
            "20 yaw rates",
            "the yaw rate in every period (20 times) with a standard deviation of 1 deg/s and no bias",
        ),
        (
            Ranges(beacons=[(1, 2)], noise=0.05, every=11, lever_arm={"x": -0.1}),
            "the distances to 1 beacon at 2 times",
            "the distances to 1 beacon at (1, 2) m at every 11th sample (2 times) with a standard deviation "
            "of 50 mm, taken 100 mm behind the robot's origin",
        ),
        (
            Landmarks(
                landmarks=[(1, 2), (3, 4)],
                noise={"range": 0.03, "bearing": math.radians(1)},
                map="unknown",
                lever_arm={"x": 0.1},
            ),
            "the ranges and bearings of 2 landmarks at 21 times",
            "the ranges and bearings of 2 landmarks at (1, 2) m and (3, 4) m at every sample (21 times) with "
            "standard deviations of 30 mm in range and 1 deg in bearing, the point met to 5 mm across, taken "
            "100 mm ahead of the robot's origin, the landmarks' places not known",
        ),
        (
            Tags(tags=[(1, 2, 0)], quantities=("orientation",), noise={"orientation": math.radians(2)}),
            "the orientations of 1 tag at 21 times",
            "the orientations of 1 tag at (1, 2) m at every sample (21 times) with a standard deviation of "
            "2 deg in orientation",
        ),
        (
            YawRate(noise=math.radians(1), scale=0.02),
            "20 yaw rates",
            "the yaw rate in every period (20 times) with a standard deviation of 1 deg/s, times a scale "
            "that is not known",
        ),
        (
            Ranges(beacons=[(1, 2)], noise=0.05, bias="unknown", map=0.02, latency="unknown"),
            "the distances to 1 beacon at 21 times",
            "the distances to 1 beacon at (1, 2) m at every sample (21 times) with a standard deviation of "
            "50 mm, by a time later that is not known, the beacons' places known roughly, plus a bias that "
            "is not known",
        ),
        (
            Poses(noise={"position": 0.01, "heading": 0.01}, every=3),
            "7 poses (x, y and heading)",
            "x, y and heading at every 3rd sample (7 times) with standard deviations of 10 mm per coordinate "
            "and 0.573 deg in heading",
        ),
        (
            RelativePoses(
                noise={"position": 0.002, "heading": math.radians(0.2)},
                mounting={"x": 0.1, "y": -0.02, "heading": math.radians(90)},
                every=5,
            ),
            "4 relative poses",
            "the sensor's motion (x, y and heading) since the reading before at every 5th sample (4 times) "
            "with standard deviations of 2 mm per coordinate and 0.2 deg in heading; the sensor sits 100 mm "
            "ahead of and 20 mm to the right of the robot's origin and is turned by 90 deg, estimated too",
        ),
        (
            Compass(every=4),
            "6 readings of the compass",
            "the compass at every 4th sample (6 times) with a standard deviation of 0.05 in SI units",
        ),
        (
            Doppler(lever_arm={"x": 0.1, "y": 0.2}),
            "20 readings of the doppler",
            "the speed over ground in every period (20 times) with a standard deviation that depends on the "
            "drive, taken 100 mm ahead of and 200 mm to the left of the robot's origin",
        ),
        (
            Pair(correlated=False),
            "21 readings of the compass",
            "the compass at every sample (21 times) with standard deviations of 2 deg and 30 mm",
        ),
        (
            Pair(),
            "21 readings of the compass",
            "the compass at every sample (21 times) with correlated noise (standard deviations of 2 deg "
            "and 30 mm)",
        ),
        (
            Drifting(),
            "3 readings of the compass",
            "the compass at every 10th sample (3 times) with correlated noise (a standard deviation of "
            "2 deg)",
        ),
    ],
    ids=lambda value: value.kind if isinstance(value, Sensor) else "",
)
def test_sensors_in_words(sensor: Sensor, brief: str, sentence: str):
    assert sensor.brief(20) == brief
    assert sensor.sentence(20) == sentence


def test_several_are_told_one_after_the_other():
    both = Several(sensors=(YawRate(noise=0.01), Compass()))
    assert both.brief(20) == "20 yaw rates and 21 readings of the compass"
    assert both.sentence(20) == f"{YawRate(noise=0.01).sentence(20)}; {Compass().sentence(20)}"


@pytest.mark.parametrize(
    ("options", "brief"),
    [
        ({"segments": 10}, "the displacements of 10 segments"),
        ({"segments": "samples", "regressor": "heading"}, "the turns of 20 segments"),
        ({"segments": 1, "regressor": "both"}, "the displacements and turns of 1 segment"),
    ],
)
def test_displacements_in_words(options: dict[str, object], brief: str):
    assert Displacements(**options).brief(20) == brief
