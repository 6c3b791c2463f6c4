"""Dead reckoning against plain oracles: evo's pose errors, and the alignment by singular values."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from simulated import ROBOT, TRUTH, course, log_of, readings, truth_of, twists_of
from twin_drives import arcs

from oed.estimation import DeadReckoning, dead_reckoned

DRIVE = course(seconds=15.0)
NOMINAL, TRUE = np.array(ROBOT.nominal), np.array([*TRUTH.values()])
PLACE = np.array([0.1, -0.04, 0.3])
LOG = log_of(DRIVE, place=PLACE, noise=(0.002, 0.004))


def reckon(log=LOG, parameters=NOMINAL, place=PLACE, offset: float = 0.0) -> DeadReckoning:
    return dead_reckoned(ROBOT, log, parameters, place, offset)


def path_of(parameters: np.ndarray) -> np.ndarray:
    """What the sensor would have read on the wheels' own account, begun on the log's first pose."""
    x, y, heading = LOG.poses[0]
    heading -= PLACE[2]
    across = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    begin = np.array([x, y]) - across @ PLACE[:2]
    states = arcs([*begin, heading], twists_of(ROBOT, DRIVE.inputs, parameters), np.diff(DRIVE.times))
    return readings(states, PLACE)


def umeyama(path: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """The path turned and shifted onto another one [Umeyama 1991, eqs 40-42 without scale]."""
    centre, wanted = path.mean(axis=0), onto.mean(axis=0)
    left, _, right = np.linalg.svd((onto - wanted).T @ (path - centre))
    signs = np.diag([1.0, np.sign(np.linalg.det(left @ right))])
    return (path - centre) @ (left @ signs @ right).T + wanted


def homogeneous(pose: np.ndarray) -> np.ndarray:
    x, y, heading = pose
    return np.array(
        [[np.cos(heading), -np.sin(heading), x], [np.sin(heading), np.cos(heading), y], [0, 0, 1]]
    )


def relative_errors(path: np.ndarray, reference: np.ndarray, delta: float) -> tuple[np.ndarray, np.ndarray]:
    """Translation and rotation of evo's relative pose errors Q^-1 P over successive stretches, per metre."""
    marks, since = [0], 0.0
    lengths = []
    for index in range(1, len(reference)):
        since += float(np.linalg.norm(reference[index, :2] - reference[index - 1, :2]))
        if since >= delta:
            marks.append(index)
            lengths.append(since)
            since = 0.0
    moved, turned = [], []
    for (first, last), length in zip(pairwise(marks), lengths, strict=True):
        truth = np.linalg.inv(homogeneous(reference[first])) @ homogeneous(reference[last])
        guess = np.linalg.inv(homogeneous(path[first])) @ homogeneous(path[last])
        error = np.linalg.inv(truth) @ guess
        moved.append(np.linalg.norm(error[:2, 2]) / length)
        turned.append(np.arctan2(error[1, 0], error[0, 0]) / length)
    return np.array(moved), np.array(turned)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


class TestNumbers:
    FOUND, PATH = reckon(), path_of(NOMINAL)

    def test_path(self):
        assert self.FOUND.path[:-1] == pytest.approx(self.PATH[:, :2], abs=1e-9)
        assert np.array_equal(self.FOUND.reference[:-1], LOG.poses[:, :2])
        assert np.array_equal(self.FOUND.times[:-1], LOG.pose_times)
        assert self.FOUND.turns[:-1, 0] == pytest.approx(LOG.poses[:, 2], abs=1e-12)
        assert self.FOUND.turns[:-1, 1] == pytest.approx(self.PATH[:, 2], abs=1e-9)
        assert np.isnan(self.FOUND.turns[-1]).all()
        assert self.FOUND.length == pytest.approx(
            np.linalg.norm(np.diff(LOG.poses[:, :2], axis=0), axis=1).sum()
        )

    def test_absolute_pose_errors(self):
        off = np.linalg.norm(self.PATH[:, :2] - LOG.poses[:, :2], axis=1)
        assert self.FOUND.rmse_position == pytest.approx(rms(off), rel=1e-9)
        assert self.FOUND.end_position == pytest.approx(off[-1], rel=1e-9)
        turned = self.PATH[:, 2] - LOG.poses[:, 2]
        assert self.FOUND.rmse_heading == pytest.approx(rms(turned), rel=1e-9)
        assert self.FOUND.end_heading == pytest.approx(abs(turned[-1]), rel=1e-9)

    def test_aligned(self):
        off = umeyama(self.PATH[:, :2], LOG.poses[:, :2]) - LOG.poses[:, :2]
        assert self.FOUND.rmse_aligned == pytest.approx(rms(np.linalg.norm(off, axis=1)), rel=1e-9)
        assert self.FOUND.rmse_aligned < self.FOUND.rmse_position

    def test_relative_pose_errors(self):
        moved, turned = relative_errors(self.PATH, LOG.poses, 1.0)
        assert len(moved) > 1
        assert self.FOUND.drift_position == pytest.approx(rms(moved), rel=1e-9)
        assert self.FOUND.drift_heading == pytest.approx(rms(turned), rel=1e-9)

    def test_the_truth_reckons_to_the_noise(self):
        found = reckon(log_of(DRIVE, place=PLACE), TRUE)
        assert found.rmse_position == pytest.approx(0, abs=1e-9)
        assert found.drift_heading == pytest.approx(0, abs=1e-9)


class TestLogs:
    @given(turn=st.floats(-3, 3), x=st.floats(-5, 5), y=st.floats(-5, 5))
    def test_the_frame_does_not_matter(self, turn: float, x: float, y: float):
        places = (LOG.poses[:, 0] + 1j * LOG.poses[:, 1]) * np.exp(1j * turn) + x + 1j * y
        poses = np.column_stack([places.real, places.imag, LOG.poses[:, 2] + turn])
        moved, plain = reckon(replace(LOG, poses=poses)), TestNumbers.FOUND
        for name in ("length", "rmse_position", "rmse_aligned", "rmse_heading", "drift_position"):
            assert getattr(moved, name) == pytest.approx(getattr(plain, name), rel=1e-6), name

    def test_clocks_apart(self):
        log = log_of(DRIVE, place=PLACE, offset=0.7)
        assert reckon(log, TRUE, offset=0.7).rmse_position == pytest.approx(0, abs=1e-9)
        assert reckon(log, TRUE).rmse_position > 1e-3

    def test_without_headings_the_path_is_turned_onto_the_positions(self):
        log = log_of(DRIVE, place=PLACE, quantities=("x", "y"))
        found = reckon(log, TRUE)
        assert found.rmse_position == pytest.approx(0, abs=1e-6)
        assert found.rmse_heading is found.end_heading is found.drift_heading is None
        assert np.isnan(found.turns[:, 0]).all()

    def test_without_headings_only_the_opening_says_where_the_robot_faces(self):
        # A whole path that is turned to fit is off by half of what it is off from its first pose.
        drive = course(seconds=40.0, inputs=np.full((400, 2), 8.0), period=0.1)
        whole, headless = (log_of(drive, quantities=names) for names in (("x", "y", "heading"), ("x", "y")))
        wrong = TRUE * [1.01, 1.0, 1.0]
        off, found = (reckon(log, wrong, np.zeros(3)).rmse_position for log in (whole, headless))
        assert found == pytest.approx(off, rel=0.15)

    def test_goes_on_through_gaps(self):
        kept = (LOG.pose_times < 6) | (LOG.pose_times > 9)
        found = reckon(replace(LOG, pose_times=LOG.pose_times[kept], poses=LOG.poses[kept]))
        assert np.isnan(found.path[:, 0]).sum() == 1
        whole = reckon(LOG)
        assert found.path[:-1] == pytest.approx(whole.path[:-1][kept], abs=1e-6)

    def test_gaps_that_nothing_bridges_begin_anew(self):
        kept = (LOG.pose_times < 6) | (LOG.pose_times > 9)
        found = reckon(replace(LOG, pose_times=LOG.pose_times[kept], poses=LOG.poses[kept], gap=1.0))
        breaks = np.flatnonzero(np.isnan(found.path[:, 0]))
        assert len(breaks) == 2
        assert np.array_equal(np.isnan(found.times), np.isnan(found.path[:, 0]))
        after = breaks[0] + 1
        assert found.path[after] == pytest.approx(found.reference[after], abs=1e-12)

    def test_a_short_stretch_does_not_pass_for_drift(self):
        # Two poses after a gap, of which noise is all there is to see.
        kept = (LOG.pose_times < 13.5) | (LOG.pose_times > 14.85)
        log = replace(LOG, pose_times=LOG.pose_times[kept], poses=LOG.poses[kept] + 0.0)
        log.poses[-1, :2] += 0.2
        assert reckon(log).drift_position < 2 * TestNumbers.FOUND.drift_position

    def test_a_path_shorter_than_a_piece(self):
        slow = course(seconds=5.0, inputs=0.2 * DRIVE.inputs[:50])
        found = reckon(log_of(slow), place=np.zeros(3))
        assert 0 < found.length < 1
        assert found.drift_position == pytest.approx(found.end_position / found.length, rel=1e-6)

    def test_a_robot_at_rest(self):
        found = reckon(log_of(course(inputs=np.zeros((50, 2)), seconds=5)), truth_of(ROBOT), np.zeros(3))
        assert found.length == found.rmse_position == 0
        assert found.drift_position is None
