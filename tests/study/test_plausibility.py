"""Sizes that hardly mean what they say are questioned, and those of real studies are not."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from studies import small

import oed
from oed.foundation.errors import StudyError
from oed.workflow.studies import parse_study

ROOM = "x: [-1 m, 1 m], y: [-1 m, 1 m]"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "track: 18 cm",
            "track: 30",
            "robot.track: 30 is taken as 30 m, more than its room of 2 m; did you mean '30 cm'?",
        ),
        (
            "track: 18 cm",
            "track: 180",
            "180 is taken as 180 m, more than its room of 2 m; did you mean '180 cm'?",
        ),
        ("track: 18 cm", "track: 2.1", "2.1 is taken as 2.1 m, more than its room of 2 m"),
        (
            "4.9 cm",
            "4.9",
            "robot.wheel_radius: 4.9 is taken as 4.9 m, more than 2 times the robot's other sizes; did you",
        ),
        (
            "4.9 cm",
            "49",
            "49 is taken as 49 m, more than 2 times the robot's other sizes; did you mean '49 mm'?",
        ),
        (
            "4.9 cm, track: 18 cm",
            "1.2, track: 1.5",
            "1.2 is taken as 1.2 m, more than half of its room of 2 m",
        ),
        (
            "duration: 10 s",
            "duration: 1e6 s",
            "1e+06 is taken as 1e+06 s, more than a day; did you mean '1e+06 ms'?",
        ),
        ("duration: 10 s", "duration: 1e9 s", "more than a day; is its unit right?"),
        ("x: [-1 m, 1 m]", "x: [-1e9 m, 1e9 m]", "limits.workspace: the room is 2e+06 km across"),
        ("x: [-1 m, 1 m]", "x: [-1e300 m, 1e300 m]", "at most 1e+12 in SI units"),
        (
            "position: 1 cm",
            "position: 1",
            "measurement.noise.position: 1 is taken as 1 m, more than an eighth of a room of 2 m",
        ),
        (
            "heading: 1 deg",
            "heading: 1",
            "measurement.noise.heading: 1 is taken as 1 rad, more than 0.5 rad; did you mean '1 deg'?",
        ),
        (
            "samples: 40",
            "samples: 40, start: {heading: 90}",
            "90 rad, more than a full turn; did you mean '90 deg'?",
        ),
    ],
)
def test_sizes_whose_unit_may_be_missing_are_questioned(old: str, new: str, words: str):
    with pytest.raises(StudyError) as caught:
        parse_study(changed(old, new))
    assert words in str(caught.value)


def changed(old: str, new: str) -> str:
    assert old in small()
    return small().replace(old, new)


@pytest.mark.parametrize("place", ["measurement.1.noise", "measurement.0.noise.position"])
def test_the_noise_of_each_sensor_is_looked_at(place: str):
    sensors = "[{kind: poses, noise: {position: 1, heading: 1 deg}}, {kind: yaw_rate, noise: 1}]"
    lines = [line for line in small().splitlines() if not line.startswith("measurement")]
    with pytest.raises(StudyError, match=f"{place}: 1 is taken as 1 "):
        parse_study("\n".join([*lines, f"measurement: {sensors}"]))


def seeing(sensor: str, room: str = ROOM, robot: str = "kind: differential_drive") -> str:
    text = changed("kind: differential_drive", robot)
    lines = [line for line in text.replace(ROOM, room).splitlines() if not line.startswith("measurement")]
    return "\n".join([*lines, f"measurement: {sensor}"])


MARKS = "kind: landmarks, noise: {range: 3 cm, bearing: 1 deg}, landmarks"


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (
            f"{{{MARKS}: [[1, 0], [0, 1]], latency: 100 s}}",
            "measurement.latency: 100 is taken as 100 s, more than 10 s; did you mean '100 ms'?",
        ),
        (
            f"[{{kind: yaw_rate, noise: 1 deg/s}}, {{{MARKS}: [[1, 0], [1000 km, 0]]}}]",
            "measurement.1.landmarks.1: is 1000 km from everything else, too far to be seen",
        ),
        (
            f"{{{MARKS}: [[1, 0], [0, 1]], lever_arm: {{x: 12}}}}",
            "measurement.lever_arm.x: 12 is taken as 12 m, more than its room of 2 m; did you mean '12 cm'?",
        ),
        (
            "{kind: relative_poses, noise: {position: 1 cm, heading: 1 deg}, mounting: {y: -12}}",
            "measurement.mounting.y: 12 is taken as 12 m, more than its room of 2 m; did you mean '12 cm'?",
        ),
        (f"{{{MARKS}: [[1, 0], [0, 1], [1, 0]]}}", "measurement.landmarks.2: is where landmark 1 is"),
        (
            f"[{{kind: yaw_rate, noise: 1 deg/s}}, {{{MARKS}: [[1, 0], [1, 0]], ids: [a, b]}}]",
            "measurement.1.landmarks.1: is where landmark a is; give each a place of its own",
        ),
        (f"{{{MARKS}: [[1, 0], [0, 1]], ids: [a, a]}}", "measurement.ids: the id a is listed twice"),
        (
            "{kind: ranges, noise: 5 cm, beacons: [[1, 0], [0, 1], [0, 1]]}",
            "measurement.beacons.2: is where beacon 2 is",
        ),
        (
            "{kind: tags, quantities: [range], noise: {range: 3 cm}, tags: [[1, 0, 0], [1, 0, 0]]}",
            "measurement.tags.1: is where tag 1 is",
        ),
    ],
)
def test_places_and_times_of_sensors_are_looked_at(sensor: str, words: str):
    with pytest.raises(StudyError) as caught:
        parse_study(seeing(sensor))
    assert words in str(caught.value)


def test_a_lag_that_no_robot_has_is_questioned():
    robot = "robot: {kind: unicycle, lag_v: 100}"
    with pytest.raises(StudyError, match=r"robot.lag_v: 100 is taken as 100 s, more than 10 s; did you mean"):
        parse_study(
            re.sub("robot: .*", robot, seeing("{kind: poses, noise: {position: 1 cm, heading: 1 deg}}"))
        )


@pytest.mark.parametrize(
    "sensor",
    [
        # Both sides of a board, and a clock that is seconds apart.
        "{kind: tags, quantities: [range], noise: {range: 3 cm}, tags: [[1, 0, 0], [1, 0, 180 deg]]}",
        f"{{{MARKS}: [[1, 0], [0, 1]], latency: 2 s}}",
    ],
)
def test_places_and_times_of_real_sensors_are_not(sensor: str):
    parse_study(seeing(sensor))


@pytest.mark.parametrize("designed", [False, True])
def test_places_in_the_coordinates_of_a_country_are_not(designed: bool):
    text = seeing(
        f"{{{MARKS}: [[500003, 5400001], [500001, 5400004]]}}", "x: [5e5, 500010], y: [5.4e6, 5400010]"
    )
    if designed:
        parse_study(text.replace("samples: 40", "samples: 40, start: {x: 500005, y: 5400005}"))
    else:
        parse_study(re.sub(r"(trajectory: .*|limits:\n( .*\n)*|solvers: .*)", "", text))


@pytest.mark.parametrize(
    ("robot", "room"),
    [
        ("wheel_radius: 0.9, track: 1.8", "x: [-15, 15], y: [-10, 10]"),
        ("wheel_radius: 1.8, track: 6", "x: [-60, 60], y: [-40, 40]"),
        ("wheel_radius: 0.02, track: 0.09", "x: [-0.3, 0.3], y: [-0.3, 0.3]"),
        ("wheel_radius: 0.25, track: 0.2", ROOM),
        ("wheel_radius: 0.1, track: 0.5", "x: [-0.15, 0.15], y: [-0.15, 0.15]"),
        ("wheel_radius: 4.9 cm, track: 31.41593 m", ROOM),
    ],
)
def test_real_robots_are_not_and_nor_is_what_is_computed(robot: str, room: str):
    parse_study(changed("wheel_radius: 4.9 cm, track: 18 cm", robot).replace(ROOM, room))


@pytest.mark.parametrize("noise", ["position: 2.5, heading: 5 deg", "position: 3 cm, heading: 0.4"])
def test_noise_of_real_sensors_is_not(noise: str):
    yard = "x: [-15, 15], y: [-10, 10]"
    parse_study(changed("position: 1 cm, heading: 1 deg", noise).replace(ROOM, yard))


def test_a_robot_without_a_room_is_compared_with_its_wheels():
    text = small().replace(f"  workspace: {{kind: rectangle, {ROOM}}}\n", "")
    parse_study(text.replace("track: 18 cm", "track: 4 m"))
    for track, words in [("18", "100 times its wheels' radius"), ("20 km", "100 times its wheels' radius")]:
        with pytest.raises(StudyError, match=words):
            parse_study(text.replace("track: 18 cm", f"track: {track}"))


def test_a_size_in_a_room_smaller_than_the_robot_is_not():
    parse_study(changed(ROOM, "x: [-1 mm, 1 mm], y: [-1 mm, 1 mm]"))


@pytest.mark.parametrize(
    ("part", "value", "words"),
    [
        ("model", oed.DifferentialDrive(wheel_radius=0.049, track=30), "robot.track: 30 is taken as 30 m"),
        (
            "model",
            oed.DifferentialDrive(wheel_radius=4.9, track=0.18),
            "robot.wheel_radius: 4.9 is taken as 4.9 m",
        ),
        ("design", oed.DesignSpace(duration="1e9 s"), "trajectory.duration: 1e+09 is taken as 1e+09 s"),
        ("measurement", oed.YawRate(noise=1), "measurement.noise: 1 is taken as 1 rad/s"),
        (
            "limits",
            [oed.WheelSpeed(bounds=10), oed.EndHeading(at=90)],
            "end_heading: 90 is taken as 90 rad",
        ),
    ],
)
def test_problems_made_in_python_are_questioned_likewise(part: str, value: object, words: str):
    problem = parse_study(small()).problem
    with pytest.raises(oed.ProblemError) as caught:
        replace(problem, **{part: value})
    assert words in str(caught.value)


def test_a_day_widened_by_a_tolerance_is_a_day():
    problem = parse_study(changed("duration: 10 s", "duration: 86400 s")).problem
    assert problem.widened(1e-2).design.duration > problem.design.duration


def test_angles_of_steering_are_looked_at():
    text = changed(
        "{kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}",
        "{kind: tricycle, wheel_radius: 5 cm, wheelbase: 40 cm}",
    )
    with pytest.raises(StudyError, match="steering_angle: 30 is taken as 30 rad"):
        parse_study(text.replace("limits:\n", "limits:\n  steering_angle: 30\n"))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("robot: {kind: differential_drive", "robot: {preset: huskey", "got 'huskey'; did you mean husky?"),
        ("kind: differential_drive", "kind: diff_drive", "'diff_drive'; did you mean differential_drive?"),
        ("{kind: E, scaling: none}", "e-optimal", "G, I, got 'e-optimal'; did you mean E?"),
        ("{kind: E, scaling: none}", "d", "G, I, got 'd'; did you mean D?"),
        ("criterion:", "estimate: [trak]\ncriterion:", "got trak; did you mean track?"),
        (
            "criterion:",
            "log: {inputs: {wheel_speed_rigth: w}}\ncriterion:",
            "did you mean wheel_speed_right?",
        ),
        ("criterion:", "log: {poses: {headng: h}}\ncriterion:", "did you mean heading?"),
        ("criterion:", "baselines: [strait]\ncriterion:", "got 'strait'; did you mean straight?"),
    ],
)
def test_what_was_meant(old: str, new: str, words: str):
    with pytest.raises(StudyError) as caught:
        parse_study(small().replace(old, new))
    assert str(caught.value).endswith(words)
