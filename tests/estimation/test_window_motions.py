"""Motions between windows' ends: what they are, what predicts them, when there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import ROBOT, TRUTH, course, log_of, truth_of, unknowns_of
from windowed import ICR, PLACE, SITS, TRICYCLE, gls, two_stage, windows_of

from oed.estimation.methods.windows import end_rates, relative_to_first, require_windows
from oed.foundation.errors import ProblemError


def test_what_is_measured_does_not_depend_on_the_frame():
    log = log_of(course(), noise=(0.002, 0.01))
    turn = 0.8
    across = (log.poses[:, 0] + 1j * log.poses[:, 1]) * np.exp(1j * turn)
    moved = np.column_stack([across.real + 4, across.imag - 7, log.poses[:, 2] + turn])
    again = windows_of([replace(log, poses=moved)])
    np.testing.assert_allclose(again.measured, windows_of([log]).measured, atol=1e-12)


def test_only_the_ends_count():
    log = log_of(course())
    windows = windows_of([log])
    inner = np.ones(len(log.pose_times), dtype=bool)
    ends = np.unique(windows.layout.times[:, [0, -1]])
    inner[np.searchsorted(log.pose_times, ends)] = False
    wrong = replace(log, poses=log.poses + inner[:, None] * 5.0)
    np.testing.assert_array_equal(windows_of([wrong]).measured, windows.measured)


@pytest.mark.parametrize("model", [ROBOT, ICR, TRICYCLE], ids=lambda one: one.kind)
def test_true_unknowns_explain_every_motion(model):
    truth = truth_of(model)
    log = log_of(course(model, truth), place=SITS)
    windows = windows_of([log], unknowns_of(model, place=PLACE))
    assert np.abs(windows.motions(np.concatenate([truth, SITS])).residuals).max() < 1e-12


@pytest.mark.parametrize("model", [ROBOT, ICR, TRICYCLE], ids=lambda one: one.kind)
@pytest.mark.parametrize("place", [PLACE, ("sensor_y",)], ids=["all", "one"])
def test_derivatives_are_difference_quotients(model, place):
    drives = [course(model, truth_of(model), seed=seed) for seed in range(2)]
    logs = [log_of(drive, name=str(number)) for number, drive in enumerate(drives)]
    windows = windows_of(logs, unknowns_of(model, place=place, clocks=2, sits=(0.04, 0.0, -0.1)))
    size = windows.unknowns.size
    # Within a step of the clock motion is smooth at an offset that puts no knot beside a pose.
    values = windows.unknowns.nominal + 0.03 * np.random.default_rng(0).uniform(0.5, 1, size)
    step = 1e-6
    quotients = [
        (windows.motions(values - move).residuals - windows.motions(values + move).residuals) / (2 * step)
        for move in step * np.eye(size)
    ]
    slopes = windows.motions(values).slopes
    np.testing.assert_allclose(slopes, np.stack(quotients, axis=-1), rtol=1e-5, atol=1e-5)


@pytest.mark.slow
def test_order_of_the_quantities_does_not_matter():
    drive = course()
    one = log_of(drive)
    other = replace(one, poses=one.poses[:, [2, 0, 1]], quantities=("heading", "x", "y"))
    np.testing.assert_array_equal(windows_of([one]).measured, windows_of([other]).measured)
    first, second = gls([one]), gls([other])
    np.testing.assert_allclose(first.values, second.values)
    np.testing.assert_allclose(first.residuals[..., [2, 0, 1]], second.residuals, atol=1e-12)


def test_windows_are_linked_within_a_log_but_not_over_a_gap():
    log = log_of(course(seconds=20))
    kept = (log.pose_times < 7.95) | (log.pose_times > 12.05)
    gap = replace(log, pose_times=log.pose_times[kept], poses=log.poses[kept])
    windows = windows_of([gap, log_of(course(seconds=6), name="other")])
    assert windows.layout.count == 11
    assert np.flatnonzero(~windows.linked).tolist() == [3, 7]


def test_rates_at_the_ends_are_velocities_of_the_sensor():
    steps = np.full((1, 6), 0.1)
    path = np.zeros((1, 7, 3))
    path[0, :, 2] = 0.5 * np.arange(7) * 0.1
    path[0, :, 0] = 0.3 * np.arange(7) * 0.1
    rates = end_rates(path, steps)
    np.testing.assert_allclose(rates[0, :, 2], 0.5)
    np.testing.assert_allclose(np.hypot(rates[0, :, 0], rates[0, :, 1]), 0.3)
    assert rates[0, 1, 1] == pytest.approx(-0.3 * np.sin(0.3))


def test_seen_from_first_begins_at_the_origin():
    poses = np.random.default_rng(0).normal(size=(4, 5, 3))
    np.testing.assert_allclose(relative_to_first(poses)[:, 0], 0.0)
    distance = np.linalg.norm(poses[:, 3, :2] - poses[:, 0, :2], axis=1)
    np.testing.assert_allclose(np.linalg.norm(relative_to_first(poses)[:, 3, :2], axis=1), distance)


@pytest.mark.parametrize("method", [gls, two_stage])
def test_logs_without_headings_are_refused(method):
    log = log_of(course(), quantities=("x", "y"))
    with pytest.raises(ProblemError, match=r"calibration\.method: .*the logs hold x, y; use method: joint"):
        method([log])


def test_other_states_are_not_left_out_silently():
    log = log_of(course())
    poses = np.column_stack([log.poses, log.poses[:, 2]])
    other = replace(log, poses=poses, quantities=("x", "y", "heading", "trailer_angle"))
    with pytest.raises(ProblemError, match="trailer_angle"):
        require_windows(windows_of([other]).layout, unknowns_of(), "gls")


def test_too_few_windows_are_refused():
    log = log_of(course(seconds=20))
    with pytest.raises(ProblemError, match=r"calibration\.segment: 2 windows are too few for 3 unknowns"):
        gls([log], seconds=10)
    assert gls([log], seconds=5).values == pytest.approx(truth_of(ROBOT, **TRUTH))
