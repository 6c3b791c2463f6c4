"""The covariance of windows' motions, and what residuals say of its parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import ROBOT, TRUTH, course, log_of, truth_of
from windowed import drifting, gls, windows_of

from oed.estimation.methods import bands
from oed.estimation.methods.window_noise import PARTS, Course, Likelihood
from oed.estimation.methods.windows import relative_to_first

TRUE = truth_of(ROBOT, **TRUTH)


def dense(band: np.ndarray) -> np.ndarray:
    size = band.shape[1]
    found = np.zeros((size, size))
    for off in range(len(band)):
        for column in range(size - off):
            found[column + off, column] = found[column, column + off] = band[off, column]
    return found


def some_band(count: int = 5, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    own, below = rng.normal(size=(count, 3, 3)), rng.normal(size=(count - 1, 3, 3))
    return bands.banded(own @ own.transpose(0, 2, 1) + 20 * np.eye(3), below)


def some_course() -> Course:
    windows = windows_of([log_of(course(seconds=8)), log_of(course(seconds=4, seed=1), name="other")])
    return Course(windows.motions(TRUE).path, windows.layout.steps, windows.linked)


def test_blocks_are_where_they_belong():
    own, below = np.arange(18.0).reshape(2, 3, 3), 100 + np.arange(9.0).reshape(1, 3, 3)
    full = dense(bands.banded(own + own.transpose(0, 2, 1), below))
    np.testing.assert_array_equal(full[3:, 3:], own[1] + own[1].T)
    np.testing.assert_array_equal(full[3:, :3], below[0])


def test_bands_compute_as_full_matrices_do():
    band, other = some_band(), some_band(seed=1)
    full, root = dense(band), bands.factor(band)
    rows = np.random.default_rng(2).normal(size=(15, 2))
    np.testing.assert_allclose(bands.whitened(root, rows), np.linalg.solve(np.linalg.cholesky(full), rows))
    back = bands.weighted(root, bands.whitened(root, rows))
    np.testing.assert_allclose(back, np.linalg.solve(full, rows))
    np.testing.assert_allclose(bands.form(band, rows), rows.T @ full @ rows)
    inverse, block = np.linalg.inv(full), np.arange(15) // 3
    near = np.abs(np.subtract.outer(block, block)) <= 1
    np.testing.assert_allclose(dense(bands.inverse(root)), inverse * near, atol=1e-12)
    np.testing.assert_allclose(
        bands.traces(other[None], bands.inverse(root)), np.trace(dense(other) @ inverse)
    )
    symmetric = rows @ rows.T
    np.testing.assert_allclose(
        bands.traces(other[None], bands.product(rows, rows)), np.trace(dense(other) @ symmetric)
    )


def test_noise_of_poses_is_shared_by_neighbours_as_differences_say():
    drive = some_course()
    count = len(drive.linked) + 1
    nodes = [0, *np.cumsum([1 if linked else 2 for linked in drive.linked])]
    poses = np.zeros((nodes[-1] + 2, 3))
    for window, node in enumerate(nodes):
        # The true poses at the ends, one after the other.
        x, y, heading = poses[node]
        ahead = (drive.path[window, -1, 0] + 1j * drive.path[window, -1, 1]) * np.exp(1j * heading)
        last = [x + ahead.real, y + ahead.imag, heading + drive.path[window, -1, 2]]
        poses[node + 1] = last
        if window + 1 < count and nodes[window + 1] > node + 1:
            poses[nodes[window + 1]] = [1.0, 2.0, 0.4]

    def motions(errors: np.ndarray) -> np.ndarray:
        read = poses + errors.reshape(poses.shape)
        return np.concatenate([relative_to_first(read[None, node : node + 2])[0, 1] for node in nodes])

    step = 1e-6
    effects = np.column_stack(
        [(motions(step * unit) - motions(-step * unit)) / (2 * step) for unit in np.eye(poses.size)]
    )
    for part, kept in ((0, [1, 1, 0]), (1, [0, 0, 1])):
        variances = np.diag(np.tile(kept, len(poses)))
        expected = effects @ variances @ effects.T
        np.testing.assert_allclose(dense(drive.parts[part]), expected, atol=1e-8)


@pytest.mark.parametrize(("part", "error"), [(3, 0), (4, 1), (5, 2), (6, 2)])
def test_drift_is_carried_to_the_windows_end(part, error):
    drive = some_course()
    moves = np.diff(drive.path, axis=1)
    heading = drive.path[:, :-1, 2] + moves[..., 2] / 2
    local = np.stack(
        [
            np.cos(heading) * moves[..., 0] + np.sin(heading) * moves[..., 1],
            np.cos(heading) * moves[..., 1] - np.sin(heading) * moves[..., 0],
            moves[..., 2],
        ],
        axis=-1,
    )

    def end(window: int, steps: np.ndarray) -> np.ndarray:
        place, turned = 0j, 0.0
        for ahead, left, turn in steps:
            place += (ahead + 1j * left) * np.exp(1j * (turned + turn / 2))
            turned += turn
        return np.array([place.real, place.imag, turned])

    step, window = 1e-6, 1
    expected = np.zeros((3, 3))
    for index, one in enumerate(local[window]):
        moved = np.zeros_like(local[window])
        moved[index, error] = step
        effect = (end(window, local[window] + moved) - end(window, local[window] - moved)) / (2 * step)
        weight = abs(one[2]) if part == 6 else np.hypot(*one[:2])
        expected += weight * np.outer(effect, effect)
    found = dense(drive.parts[part])
    np.testing.assert_allclose(found[3:6, 3:6], expected, atol=1e-9)
    np.testing.assert_array_equal(found[3:6, :3], 0.0)


def some_likelihood() -> Likelihood:
    rng, drive = np.random.default_rng(3), some_course()
    rows = rng.normal(size=(drive.parts.shape[2], 4)) * [0.01, 1, 1, 1]
    return Likelihood(drive.parts, np.zeros(drive.parts.shape[1:]), rows, (np.diag([1.0, 2, 3]), np.ones(3)))


SOME = np.array([1e-6, 3e-5, 1e-4, 1e-5, 2e-5, 4e-4, 3e-4])


def test_restricted_likelihood_is_that_of_full_matrices():
    likelihood = some_likelihood()
    covariance = dense(likelihood.covariance(SOME))
    inverse = np.linalg.inv(covariance)
    residuals, slopes = likelihood.rows[:, 0], likelihood.rows[:, 1:]
    normal = slopes.T @ inverse @ slopes + likelihood.known[0]
    right = slopes.T @ inverse @ residuals + likelihood.known[1]
    expected = residuals @ inverse @ residuals - right @ np.linalg.solve(normal, right)
    expected += np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]
    assert likelihood.surprise(SOME)[0] == pytest.approx(expected)


@pytest.mark.parametrize("part", range(len(PARTS)))
def test_its_derivatives_are_difference_quotients(part):
    likelihood, step = some_likelihood(), np.zeros(len(SOME))
    step[part] = 1e-5 * SOME[part]
    quotient = likelihood.surprise(SOME + step)[0] - likelihood.surprise(SOME - step)[0]
    found = likelihood.surprise(SOME)[1][part]
    assert found == pytest.approx(quotient / (2 * step[part]), rel=1e-4)


@pytest.mark.slow
def test_variances_are_known_as_well_as_the_likelihood_is_curved():
    deviation = np.full(len(SOME), 1.5)
    likelihood = replace(some_likelihood(), prior=(np.log(SOME), deviation))
    logs = np.log(likelihood.greatest())

    def surprise(at: np.ndarray) -> float:
        return likelihood.surprise(np.exp(at))[0]

    units = 1e-2 * np.eye(len(logs))
    curvature = [
        [
            surprise(logs + one + other)
            - surprise(logs + one - other)
            - surprise(logs - one + other)
            + surprise(logs - one - other)
            for other in units
        ]
        for one in units
    ]
    # Minus twice the logarithm of the likelihood.
    information = np.array(curvature) / (4 * 1e-2**2) / 2
    values, vectors = np.linalg.eigh(information)
    expected = (vectors / np.maximum(values, 1 / deviation**2)) @ vectors.T
    np.testing.assert_allclose(likelihood.spread(np.exp(logs)), expected, atol=0.02)
    assert np.linalg.eigvalsh(expected)[0] < 0.5 * deviation[0] ** 2


@pytest.mark.slow
def test_noise_and_drift_are_told_apart():
    drive = drifting(course(seconds=400, period=0.2), TRUE, (0.01, 0.005, 0.03), seed=0)
    fit = gls([log_of(drive, noise=(0.001, 0.005))])
    assert fit.noises["position"].at_rest == pytest.approx(0.001, rel=0.2)
    assert fit.noises["heading"].at_rest == pytest.approx(0.005, rel=0.2)
    (note,) = fit.notes
    numbers = [float(word) for word in note.split() if word.replace(".", "").isdigit()]
    assert numbers[:2] == pytest.approx([10, 5], rel=0.25)


@pytest.mark.slow
def test_jitter_of_the_clock_grows_with_speed():
    drive = course(seconds=400, period=0.2)
    late = np.random.default_rng(5).normal(scale=0.01, size=len(drive.times))
    log = log_of(drive, noise=(0.0002, 0.0005))
    poses = np.column_stack([np.interp(drive.times + late, drive.times, row) for row in log.poses.T])
    fit = gls([type(log)(**{**vars(log), "poses": poses})])
    # Between the knots the readings are interpolated, which takes off a part.
    assert fit.noises["position"].per_speed == pytest.approx(0.01, rel=0.2)
    assert fit.noises["heading"].per_yaw_rate == fit.noises["position"].per_speed


def test_at_rest_there_is_no_drift_to_find():
    likelihood = some_likelihood()
    still = Likelihood(
        np.zeros_like(likelihood.parts), likelihood.parts[0], likelihood.rows, likelihood.known
    )
    np.testing.assert_array_equal(still.greatest(), 0.0)
