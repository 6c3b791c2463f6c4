"""The points of a sweep: studies with the values put in, and all their mistakes at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from studies import small, write_study

from oed.foundation.errors import StudyError, UserMistake
from oed.workflow.sweep import Point, grid, parse_axis


def points_of(folder: Path, *over: str, text: str | None = None) -> list[Point]:
    file = write_study(folder, small() if text is None else text)
    return grid(str(file), [parse_axis(one) for one in over])


def test_all_combinations_in_order(tmp_path: Path):
    points = points_of(tmp_path, "limits.wheel_speed=5,8 rad/s", "solvers.0.starts=1,3")
    assert [tuple(point.texts.values()) for point in points] == [
        ("5 rad/s", "1"),
        ("5 rad/s", "3"),
        ("8 rad/s", "1"),
        ("8 rad/s", "3"),
    ]
    assert [point.study.solvers[0].starts for point in points] == [1, 3, 1, 3]
    speeds = [point.study.problem.input_bounds[0, 1] for point in points]
    assert speeds == [5, 5, 8, 8]
    assert points[1].label == "wheel_speed 5 rad/s, starts 3"
    assert points[1].study.name == "Small study (wheel_speed 5 rad/s, starts 3)"
    assert points[1].numbers == {"limits.wheel_speed": 5, "solvers.0.starts": 3}
    assert len({point.folder for point in points}) == 4


def test_a_key_that_the_file_leaves_out_is_put_in(tmp_path: Path):
    (point,) = points_of(tmp_path, "validation.replicates=200")
    assert point.study.file.validation.replicates == 200


def test_values_that_make_no_names_get_folders_of_their_own(tmp_path: Path):
    points = points_of(tmp_path, "limits.wheel_speed=[-5, 5],[-5; 5]".replace(";", ".0,"))
    assert len({point.folder for point in points}) == 2
    assert all(point.folder.startswith("wheel_speed_") and "/" not in point.folder for point in points)


def test_long_names_are_cut_to_what_file_systems_hold(tmp_path: Path):
    (point,) = points_of(tmp_path, f"name={chr(0x20000) * 90}")
    assert len(point.folder.encode()) <= 100


@pytest.mark.slow
def test_more_values_leave_the_folders_as_they_were(tmp_path: Path):
    few = points_of(tmp_path, "limits.wheel_speed=5,8 rad/s")
    more = points_of(tmp_path, "limits.wheel_speed=4,5,8,9 rad/s")
    assert {point.folder for point in few} < {point.folder for point in more}


def test_kinds_are_called_by_what_they_are_kinds_of(tmp_path: Path):
    first, _ = points_of(tmp_path, "criterion.kind=D,A")
    assert first.label == "criterion D"


def test_every_mistake_is_told_before_anything_is_run(tmp_path: Path):
    with pytest.raises(StudyError) as caught:
        points_of(tmp_path, "limits.wheel_speed=5 m,8 rad/s", "trajectory.samples=40,0", "criterion.knd=E")
    issues = {issue.key: issue for issue in caught.value.issues}
    assert issues["limits.wheel_speed"].message.startswith(
        "with wheel_speed 5 m, samples 40, knd E and 1 more: expected an angular speed"
    )
    assert issues["trajectory.samples"].message.startswith(
        "with wheel_speed 5 m, samples 0, knd E and 1 more:"
    )
    # Wrong whatever the other values: said once, of no combination.
    assert issues["criterion.knd"].message.startswith("unknown key; did you mean kind?")
    assert [issues[key].line for key in ("trajectory.samples", "limits.wheel_speed")] == [4, 7]
    # The file has no such key, so no line of it is to blame.
    assert (issues["criterion.knd"].file, issues["criterion.knd"].line) == ("--over", 0)


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ("zzz=1", "--over: zzz: unknown key; known here: "),
        ("robot.zzz=1,2", "--over: robot.zzz: unknown key; known here: "),
        ("trajectory.samples=0", "--over: trajectory.samples: expected"),
        ("limits.wheel_speed=[1 m, 2 m]", "--over: limits.wheel_speed: expected an angular speed"),
        ("robot.kind=ackermann", "study.yaml:3: robot.wheelbase: missing"),
    ],
)
def test_what_only_the_option_says_is_no_fault_of_the_file(tmp_path: Path, over: str, said: str):
    with pytest.raises(StudyError) as caught:
        points_of(tmp_path, over)
    assert any(said in line for line in str(caught.value).splitlines()), str(caught.value)


def test_parameters_that_no_drive_tells_apart_are_told_before(tmp_path: Path):
    text = small().replace("segments: 4,", "segments: 4, regressor: heading,")
    with pytest.raises(StudyError, match=r"with estimate \["):
        points_of(tmp_path, "estimate=[c11],[c11, c99]", text=text)


@pytest.mark.parametrize(
    ("over", "message"),
    [
        (("solvers.5.starts=1",), "index from 0 to 0"),
        (("solvers.ipopt.starts=1",), "index from 0 to 0"),
        (("limits.wheel_speed.right=1",), "nothing to put 'right' into"),
        (("seed=1,2", "seed=3"), "seed is swept twice"),
    ],
)
def test_keys_that_are_not_there(tmp_path: Path, over: tuple[str, ...], message: str):
    with pytest.raises(UserMistake, match=message):
        points_of(tmp_path, *over)
