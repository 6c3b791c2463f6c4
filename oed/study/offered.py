"""Sensors that a first study may measure with: what they are, how noisy they usually are, and their YAML."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from oed.foundation.errors import UserMistake
from oed.foundation.quantities import parse_quantity, plain_number
from oed.foundation.text import did_you_mean, words


@dataclass(frozen=True)
class Offer:
    """A sensor that a first study may have.

    Attributes:
        text: what it is.
        noise: the usual standard deviation of each of its quantities, with its unit.
        entries: YAML of the sensors it is made of; {position} and so on stand for the noise, {beacons} for
            the places of beacons, {mounting} for how a sensor that is to be known is mounted.
        aliases: what people call it.
        headings: whether logs of it have the robot's heading.
        relative: whether logs of it have motions instead of poses.
        alone: whether a trailer's angle cannot be measured beside it.
    """

    text: str
    noise: Mapping[str, str]
    entries: Sequence[str]
    aliases: Sequence[str]
    headings: bool = True
    relative: bool = False
    alone: bool = False

    @property
    def drifts(self) -> bool:
        """True where odometry drift is part of the sensor's likelihood."""
        return any("drift:" in entry for entry in self.entries)


POSITION, HEADING = "1 cm", "1 deg"
OFFERS = {
    "poses": Offer(
        "motion capture: position and heading at every sample",
        {"position": POSITION, "heading": HEADING},
        ["{{kind: poses, noise: {{position: {position}, heading: {heading}}}, drift: usual}}"],
        (
            "pose",
            "motion capture",
            "mocap",
            "optitrack",
            "vicon",
            "camera",
            "marker",
            "apriltag",
            "aruco",
            "lidar",
            "slam",
        ),
    ),
    "positions": Offer(
        "laser tracker or GPS: positions only",
        {"position": POSITION},
        ["{{kind: poses, quantities: [x, y], noise: {{position: {position}}}, drift: usual}}"],
        ("laser tracker", "total station", "satellite", "gps", "gnss", "rtk"),
        headings=False,
    ),
    "positions_and_yaw_rate": Offer(
        "positions, and a gyroscope whose bias is not known",
        {"position": POSITION, "yaw_rate": "1 deg/s"},
        [
            "{{kind: poses, quantities: [x, y], noise: {{position: {position}}}, drift: usual}}",
            "{{kind: yaw_rate, noise: {yaw_rate}}}",
        ],
        ("gyroscope", "imu"),
        headings=False,
    ),
    "relative_poses": Offer(
        "lidar scan matching or visual odometry: how the sensor moved since the reading before",
        {"position": "0.5 cm", "heading": "0.5 deg"},
        [
            "{{kind: relative_poses, every: 5, noise: {{position: {position}, heading: {heading}}}{mounting}"
            ", drift: usual}}"
        ],
        ("relative pose", "scan matching", "scan matcher", "visual odometry", "icp", "lidar"),
        relative=True,
    ),
    "ranges": Offer(
        "distances to beacons in three corners of the room",
        {"distance": "3 cm"},
        ["{{kind: ranges, beacons: [{beacons}], noise: {distance}, drift: usual}}"],
        ("beacons", "anchors", "uwb", "ultra-wideband"),
        headings=False,
    ),
    "landmarks": Offer(
        "ranges and bearings of landmarks in three corners of the room, seen from the robot",
        {"range": "3 cm", "bearing": "1 deg"},
        [
            "{{kind: landmarks, landmarks: [{beacons}], noise: {{range: {range}, bearing: {bearing}}}, "
            "drift: usual}}"
        ],
        ("reflectors", "poles", "features", "radar"),
        headings=False,
    ),
    "displacements": Offer(
        "regression on the pose after each of ten segments",
        {"position": POSITION, "heading": HEADING},
        [
            "{{kind: displacements, segments: 10, regressor: both, noise: {{position: {position}, "
            "heading: {heading}}}}}"
        ],
        ("regression", "tape measure", "umbmark"),
        alone=True,
    ),
}
"""Sensors by name."""
TRAILER = "{{kind: trailer_angle, noise: {trailer_angle}}}"
"""What measures a trailer's angle, beside other sensors."""
SI = {"cm": "m", "deg": "rad", "deg/s": "rad/s"}
"""SI units of those that usual values have."""
UNITS = {"heading": "rad", "yaw_rate": "rad/s", "trailer_angle": "rad", "bearing": "rad"}
"""SI units of quantities that are no lengths."""


def offer_of(sensor: str) -> Offer:
    """A sensor by its name.

    Raises:
        UserMistake: an unknown one.
    """
    if sensor not in OFFERS:
        raise UserMistake(f"expected a sensor of {', '.join(OFFERS)}; got {sensor!r}{sensor_meant(sensor)}")
    return OFFERS[sensor]


def sensor_meant(given: str) -> str:
    """`; did you mean poses?` for what people call a sensor, or one that is spelt alike; else ""."""
    asked = words(given).strip().lower()
    known = [
        name
        for name, offer in OFFERS.items()
        if any(asked == one or re.search(rf"\b{re.escape(one)}s?\b", asked) for one in offer.aliases)
    ]
    return f"; did you mean {' or '.join(known)}?" if known else did_you_mean(given, OFFERS)


def as_studies_have(sensor: str) -> str:
    """`; what `oed init` calls positions is {kind: poses, ...}` of one of its sensors; else ""."""
    if sensor not in OFFERS:
        return ""
    usual = usual_noise(sensor, trailer=False)
    entries = ", ".join(entries_of(sensor, usual, ["..."]))
    written = entries if len(offer_of(sensor).entries) == 1 else f"[{entries}]"
    return f"; what `oed init` calls {sensor} is {written}"


def usual_noise(sensor: str, *, trailer: bool) -> dict[str, str]:
    """The usual standard deviations of a sensor's readings, of a robot with or without a `trailer`.

    Raises:
        UserMistake: an unknown sensor.
    """
    offer = offer_of(sensor)
    angle = {"trailer_angle": HEADING} if trailer and not offer.alone else {}
    return {**offer.noise, **angle}


def noise_of(sensor: str, given: Mapping[str, str], *, trailer: bool) -> dict[str, str]:
    """The standard deviations of a sensor's readings, usual ones for those that are not given.

    Args:
        sensor: its name.
        given: some of them, each with its unit.
        trailer: whether the robot has a trailer.

    Raises:
        UserMistake: a quantity that the sensor does not read, no standard deviation of its kind.
    """
    usual = usual_noise(sensor, trailer=trailer)
    for key, text in given.items():
        if key not in usual:
            hint = did_you_mean(key, usual)
            raise UserMistake(f"noise: {sensor} have noise of {', '.join(usual)}; got {key!r}{hint}")
        _require_deviation(key, text, usual[key])
    return {**usual, **given}


def _require_deviation(key: str, text: str, usual: str) -> None:
    what = f"noise of the {words(key)}"
    require_unit(what, text, usual)
    try:
        value = parse_quantity(text, UNITS.get(key, "m"))
    except ValueError as error:
        raise UserMistake(f"{what}: {error}") from None
    if not value > 0:
        raise UserMistake(f"{what}: expected a standard deviation above 0, got {text!r}")


def require_unit(what: str, given: str, usual: str) -> None:
    """Refuse a number without its unit where the usual one is not SI: nobody knows which of the two is meant.

    Args:
        what: is asked for.
        given: for it.
        usual: a value of it, with its unit.

    Raises:
        UserMistake: says both.
    """
    number, (_, _, unit) = plain_number(given), usual.partition(" ")
    if number and math.isfinite(number) and unit in SI:
        inside = f"{parse_quantity(f'{given} {unit}', SI[unit]):.2g} {SI[unit]}"
        raise UserMistake(
            f"{what}: {given} has no unit; say '{given} {unit}' ({inside}) or '{given} {SI[unit]}'"
        )


def entries_of(
    sensor: str, noise: Mapping[str, str], beacons: Sequence[str], *, mounted: bool = False
) -> list[str]:
    """YAML of each sensor that is used together.

    Args:
        sensor: its name.
        noise: the standard deviations of its quantities.
        beacons: places of beacons, as YAML has them.
        mounted: whether it has to be known how a sensor is mounted: the robot has a place of its own to find.
    """
    offer = offer_of(sensor)
    entries = [*offer.entries, *([TRAILER] if "trailer_angle" in noise else [])]
    mounting = ", mounting: {known: true}" if mounted else ""
    return [entry.format(**noise, beacons=", ".join(beacons), mounting=mounting) for entry in entries]
