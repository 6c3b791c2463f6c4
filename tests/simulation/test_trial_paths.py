"""Baselines at the pace that people drive them, and the drives that are held out."""

from __future__ import annotations

import numpy as np
import pytest
from trials import STUDY, study_of

from oed.foundation.errors import StudyError
from oed.kernel.evaluation import evaluate
from oed.robots.baselines import baselines
from oed.simulation.trial.options import held_out_drives, paced_baseline
from oed.workflow.studies import parse_study

ROBOT = "{kind: differential_drive, wheel_radius: 4.9 cm, track: 32 cm}"
SLIPPING = "{kind: skid_steer_slip, wheel_radius: 4.9 cm, track: 32 cm, yaw_lag: 10 ms}"
UNIT = np.eye(3).tolist()
"""A covariance of one pose."""
LONG = STUDY.replace("duration: 6 s, samples: 60", "duration: 20 s, samples: 100")


@pytest.mark.slow
def test_a_slow_square_is_the_lap_to_the_left_at_half_the_speed():
    problem = study_of(LONG).problem
    whole, slow = (paced_baseline(problem, name) for name in ("square", "slow_square"))
    before, after = evaluate(problem, whole), evaluate(problem, slow)
    assert before.feasible
    assert after.feasible
    assert slow.duration == whole.duration
    assert np.abs(slow.inputs).max() == pytest.approx(np.abs(whole.inputs).max() / 2)
    np.testing.assert_allclose(after.states[-1], [0, 0, 2 * np.pi], atol=1e-9)
    # It comes by where the whole one does, in twice the time.
    np.testing.assert_allclose(after.states[::2], before.states[:51], atol=1e-3)
    assert after.path_length == pytest.approx(before.path_length / 2, rel=1e-6)


@pytest.mark.slow
def test_other_paths_are_the_baselines():
    problem = study_of().problem
    (plain,) = baselines(problem, "circle")
    np.testing.assert_array_equal(paced_baseline(problem, "circle").inputs, plain.trajectory.inputs)


@pytest.mark.slow
def test_held_out_drives_are_none_that_is_calibrated_from():
    problem = study_of().problem
    drives = [paced_baseline(problem, "random", seed=3), *held_out_drives(problem, 3, seed=3)]
    drives += held_out_drives(problem, 2, seed=4)
    assert all(evaluate(problem, drive).feasible for drive in drives)
    table = np.array([drive.inputs / np.abs(drive.inputs).max() for drive in drives])
    apart = [np.abs(one - other).max() for k, one in enumerate(table) for other in table[:k]]
    assert min(apart) > 0.1
    again = held_out_drives(problem, 3, seed=3)[2]
    np.testing.assert_array_equal(again.inputs, drives[3].inputs)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (
            ROBOT,
            "{kind: mecanum, wheel_radius: 5 cm, half_wheelbase_plus_half_track: 0.3 m}",
            "are driven by",
        ),
        (ROBOT, SLIPPING, "no coefficients, which two_stage estimates"),
        ("{kind: poses,", "{kind: poses, quantities: [x, y],", "expected a measurement of poses"),
        ("{kind: poses,", "{kind: poses, lever_arm: {x: 3 cm},", "leave out the lever arm"),
        ("noise: {position: 1 cm, heading: 1 deg}", f"noise: {{covariance: {UNIT}}}", "not as a covariance"),
        ("name: lag, ", "name: differential drive, ", "a second model named differential drive"),
        ("yaw_lag: 10 ms", "yaw_lag: 10 ms, estimate: [tracks]", "expected some of its parameters"),
        ("[circle, ", "[circle, circle, ", "circle is listed twice"),
        ("[circle, ", "[oval, ", "drives.0: expected one of straight, .*slow_square.*, got 'oval'"),
        ("[circle, ", "[sideways_square, ", "cannot move sideways"),
        ("[circle, ", "[slow_circle, ", "drives.0: expected one of straight, .*got 'slow_circle'"),
        ("frictions: [0.6]", "frictions: []", "frictions"),
        ("{kind: D}", "{kind: D, subset: [wheel_radius_right]}", ""),
        ("{kind: D}", "{kind: D, subset: [slip]}", "slip"),
        ("repeats: 3", "repeats: 1", "repeats"),
    ],
)
def test_what_does_not_fit_a_trial_is_refused_in_words(before: str, after: str, message: str):
    text = STUDY.replace(before, after)
    if not message:
        parse_study(text)
        return
    with pytest.raises(StudyError, match=message):
        parse_study(text)


def test_half_a_drive_has_whole_samples():
    odd = LONG.replace("samples: 100", "samples: 101").replace("[circle,", "[slow_square,")
    with pytest.raises(StudyError, match="slow_square needs an even number of samples, got 101"):
        parse_study(odd)
