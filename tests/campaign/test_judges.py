"""The campaign's judges: each has to see what it is there for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from oracle import differential_twist, roll_out

from .cases import Outcome, Verdict
from .damage.running import Ran
from .damage.verdict import as_strict, manners, taken_for_right
from .faults import damaged_results, snapshot
from .generator.drives import Drive, draw_drive
from .generator.quantities import plain
from .generator.studies import draw_study
from .oracle.information import eliminated
from .oracle.limits import excesses
from .oracle.motion import extrapolated
from .oracle.robots import robot_of
from .oracle.score import score
from .oracle.shapes import beyond_walls, inside_distance, thickness
from .oracle.splines import clamped_run, polygon_run
from .oracle.track import Track

POST = {
    "robot": {"kind": "differential_drive", "wheel_radius": 0.05, "track": 0.2},
    "trajectory": {"rest_to_rest": False},
    "measurement": {"kind": "poses", "noise": {"position": 0.01, "heading": 0.02}},
    "limits": {"obstacles": [{"kind": "circle", "x": 2.525, "y": 0.0, "radius": 0.02}]},
}
"""A post of 2 cm between two of the points that a grid of ten a sample looks at."""
AHEAD = clamped_run(10.0, 1, np.full((2, 2), 10.0), np.zeros(3), 10)


def test_the_oracle_sees_a_post_between_the_points() -> None:
    (found,) = excesses(POST, [AHEAD])
    assert found.amount == pytest.approx(0.02, rel=1e-4)
    (coarse,) = excesses(POST, [AHEAD], points=10)
    assert coarse.amount < 0


def test_the_oracle_sees_splines_peak_between_the_samples() -> None:
    limits = {"wheel_speed": 1.0, "wheel_acceleration": 1.0}
    coefficients = np.zeros((40, 2))
    coefficients[20] = 1.5
    run = clamped_run(3.0, 2, coefficients, np.zeros(3), 3)
    found = {one.limit: one.amount for one in excesses({**POST, "limits": limits}, [run])}
    assert found["wheel_speed"] == pytest.approx(1.5 * 0.75 - 1, abs=1e-3)
    assert found["wheel_acceleration"] > 10


def test_the_oracle_sees_the_jump_from_rest_of_held_steps() -> None:
    study = {**POST, "trajectory": {"rest_to_rest": True}, "limits": {"wheel_acceleration": 1.0}}
    steps = np.vstack([np.zeros((1, 2)), np.full((6, 2), 2.0), np.zeros((1, 2))])
    run = clamped_run(4.0, 0, steps, np.zeros(3), 4)
    (found,) = excesses(study, [run])
    assert found.amount == pytest.approx(3.0)


@pytest.mark.parametrize("back", [False, True])
def test_the_oracle_sees_the_jerk_from_rest_and_to_it(back: bool) -> None:
    study = {**POST, "trajectory": {"rest_to_rest": True}, "limits": {"wheel_jerk": 5.0}}
    held = np.linspace(4.0, 0.4, 10)[:, None] * np.ones((1, 2))
    run = polygon_run(held[::-1] if back else held, 10.0, np.zeros(3), rest=True)
    (found,) = excesses(study, [run])
    # From 0 to 4 rad/s in half a second, then down by 0.4 rad/s^2.
    assert found.amount == pytest.approx(3.4)


def test_tracks_agree_with_plain_loops() -> None:
    robot = robot_of(POST["robot"])
    run = clamped_run(6.0, 2, np.random.default_rng(0).uniform(-5, 5, (7, 2)), np.array([1.0, 2.0, 0.5]), 9)
    twists = np.array([differential_twist(speeds, 0.05, 0.05, 0.2) for speeds in run.held])
    poses = roll_out(twists, run.start, run.period, "arc")
    track = Track(robot, run, "arc")
    np.testing.assert_allclose(track.states.T, poses, atol=1e-12)
    x, y = track.places(np.arange(9), np.ones(9))
    np.testing.assert_allclose(np.column_stack([x, y]), poses[1:, :2], atol=1e-12)


def test_scores_change_with_what_they_are_of() -> None:
    rng = np.random.default_rng(5)
    study = draw_study(rng)
    drive: Drive = draw_drive(rng, study)
    spec = plain(study.spec)
    once = score(spec, drive.runs)
    assert once == score(spec, drive.runs)
    assert once.path_length > 0


def test_extrapolation_is_exact_to_rounding() -> None:
    found = extrapolated(lambda angle: np.cos(angle), np.zeros((1, 1)), 0.3)
    # The Gudermannian function solves it.
    assert found.item() == pytest.approx(2 * math.atan(math.tanh(0.15)), rel=1e-13)


def test_elimination_agrees_with_a_schur_complement() -> None:
    rows = np.random.default_rng(1).standard_normal((30, 5))
    told = eliminated(rows, [1, 3], [0, 2, 4], np.array([2.0, 0.5]))
    whole = np.linalg.inv(rows.T @ rows)[np.ix_([1, 3], [1, 3])]
    expected = np.diag([2.0, 0.5]) @ np.linalg.inv(whole) @ np.diag([2.0, 0.5])
    np.testing.assert_allclose(told.matrix, expected, rtol=1e-12)


def test_distances_from_a_turned_square() -> None:
    square = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    found = inside_distance(square, np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(found, [math.sqrt(0.5), -math.sqrt(0.5), -1.0])
    assert thickness(square.tolist()) == pytest.approx(math.sqrt(2))
    # Past the corner at (1, 0) both walls are as far; past the first alone it is the farther one.
    found = beyond_walls(square, np.array([1.0, 2.0, 1.5]), np.array([1.0, 0.0, 0.1]))
    np.testing.assert_allclose(found, [math.sqrt(0.5), math.sqrt(0.5), 0.6 * math.sqrt(0.5)])


SOUND = b"t,a,b\n0,1,2\n1,3,4\n2,,\n"


@pytest.mark.parametrize(
    ("damaged", "strict"),
    [
        (b"t,a,b\n0,1,2.5\n1,3,4\n2,,\n", True),
        (b"t,a,b\n0,1,2\n1,3,4\n", False),
        (b"t,a,a\n0,1,2\n1,3,4\n2,,\n", False),
        (b't,a,b\n0,1,"2\n1,3,4\n2,,\n', False),
        (b"t,a,b\n0,1,1e300\n1,3,4\n2,,\n", False),
    ],
)
def test_damage_that_a_reader_can_see(damaged: bytes, strict: bool) -> None:
    assert as_strict("path", SOUND, damaged) is strict


def test_other_numbers_without_a_word_are_a_failure() -> None:
    sound, other = Ran(0, '{"objective": 1.0}', "", 0.1), Ran(0, '{"objective": 2.0}', "", 0.1)
    cut = SOUND[: SOUND.rfind(b"2,,")]
    assert taken_for_right("path", SOUND, cut, sound, other).wrong
    assert not taken_for_right("path", SOUND, cut, sound, sound).wrong
    said = Ran(0, other.out, "note: the last row is missing", 0.1)
    assert not taken_for_right("path", SOUND, cut, sound, said).wrong


def test_manners() -> None:
    raised = 'Traceback (most recent call last):\n  File "/x/oed/y.py", line 3, in z\nKeyError: 1'
    bad = Ran(None, "\x1b[31m", "", 61.0, 3 * 2**30, raised)
    assert sum(bool(one.wrong) for one in manners(bad)) == 4
    assert not any(one.wrong for one in manners(Ran(2, "", "a sentence", 0.1)))
    assert (
        Outcome("file", 0, (Verdict("all is well"), Verdict("no hang", "61 s"))).failures[0].asked
        == "no hang"
    )


def test_results_that_are_neither_old_nor_new(tmp_path) -> None:
    (tmp_path / "record.json").write_text('{"interrupted": false, "results": []}')
    (tmp_path / "a.csv").write_text("t\n0\n")
    before = snapshot(tmp_path)
    assert not list(damaged_results(tmp_path, before))
    (tmp_path / "a.csv").write_text("t\n1\n")
    assert list(damaged_results(tmp_path, before))
