"""Sizes that hardly mean what they say are questioned, and those of real studies are not."""

from __future__ import annotations

import pytest
from studies import small

from oed.foundation.errors import StudyError
from oed.workflow.studies import parse_study


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("track: 18 cm", "track: 30", "robot.track: 30 m is larger than its room of 2 m"),
        ("wheel_radius: 4.9 cm", "wheel_radius: 49", "robot.wheel_radius: 49 m is larger than its room"),
        ("duration: 10 s", "duration: 1e9 s", "32 years"),
        ("x: [-1 m, 1 m]", "x: [-1e9 m, 1e9 m]", "limits.workspace: the room is 2e+06 km across"),
        ("x: [-1 m, 1 m]", "x: [-1e300 m, 1e300 m]", "at most 1e+12 in SI units"),
    ],
)
def test_absurd_sizes_are_named(old: str, new: str, words: str):
    with pytest.raises(StudyError) as caught:
        parse_study(small().replace(old, new))
    assert words in str(caught.value)


def test_a_robot_without_a_room_may_be_large_but_not_any():
    text = small().replace("  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}\n", "")
    parse_study(text.replace("track: 18 cm", "track: 30 m"))
    with pytest.raises(StudyError, match="larger than any robot"):
        parse_study(text.replace("track: 18 cm", "track: 20 km"))


@pytest.mark.parametrize(("track", "room"), [("7 m", "[-1 m, 1 m]"), ("18 cm", "[-1 mm, 1 mm]")])
def test_a_robot_larger_than_its_room_is_nobodys_mistake_unless_its_unit_may_be_missing(
    track: str, room: str
):
    parse_study(small().replace("track: 18 cm", f"track: {track}").replace("[-1 m, 1 m]", room))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("robot: {kind: differential_drive", "robot: {preset: huskey", "got 'huskey'; did you mean husky?"),
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


def test_a_size_that_is_computed_has_not_lost_its_unit():
    parse_study(small().replace("track: 18 cm", "track: 31.41593 m"))
