"""Error bars of robots that drift: what a random walk makes of estimates, and how fast logs show it to be."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
import scipy
from pulls import fewest_held, require_pulls
from sensed import PLACES, gyro, sighted, with_sensors
from simulated import (
    ORIGIN,
    ROBOT,
    TRUTH,
    arcs,
    course,
    fit_of,
    log_of,
    logged_problem,
    loosely,
    options,
    search_of,
    truth_of,
    twists_of,
    unknowns_of,
)
from windowed import drifting

from oed.estimation import Calibration, calibrate
from oed.estimation.assessment.covariance import Covariance, blocks_of, information
from oed.estimation.assessment.drift import carried_along, drift, drifting_scores
from oed.estimation.assessment.trusted_covariance import covariances_of, most_trusted
from oed.estimation.methods.drift_rates import USUAL, DriftRates, drift_rates
from oed.estimation.methods.fit import Fit, degrees_of
from oed.estimation.prediction.layout import cut
from oed.estimation.setup.noise import group_of
from oed.logs.log import Log
from oed.robots.sensors import Ranges, Several, YawRate

TRUE = truth_of(ROBOT, **TRUTH)
NOISE = (0.0005, 0.003)
USUALLY = np.sqrt(USUAL)
SITS = (0.1, -0.05, 0.2)


def driven(
    seed: int, seconds: float, factor: float = 1.0, inputs: np.ndarray | None = None, **keys: float
) -> Log:
    """A log of a robot that drifts `factor` times as far as usual."""
    drive = course(seconds=seconds, seed=seed, inputs=inputs, **keys)
    return log_of(drifting(drive, TRUE, factor * USUALLY, seed), noise=NOISE, seed=seed, name=str(seed))


Pose = tuple[complex, float]


def after(pose: Pose, move: Pose) -> Pose:
    """A motion seen from a pose, carried out from there."""
    return pose[0] + move[0] * np.exp(1j * pose[1]), pose[1] + move[1]


def as_pose(numbers: np.ndarray) -> Pose:
    return complex(numbers[0], numbers[1]), float(numbers[2])


def slopes(what: Callable[[np.ndarray], np.ndarray], size: int) -> np.ndarray:
    """Derivatives at 0 by differences, (n, size)."""
    units = 1e-6 * np.eye(size)
    return np.column_stack([(what(unit) - what(-unit)) / 2e-6 for unit in units])


def dense(fit: Fit, sits: Sequence[float]) -> Callable[[np.ndarray], np.ndarray]:
    """Covariance (p, p), by rates, of least squares whose readings move with every step's error: by full
    matrices and difference quotients of arcs, the start as unknown as the parameters.
    """
    (log,), layout, mount = fit.layout.logs, fit.layout, as_pose(np.array(sits))
    times = layout.times[0]
    steps = np.diff(times)
    speeds = np.diff(log.integrals_at(times, 0.0), axis=0) / steps[:, None]

    def path(values: np.ndarray, start: np.ndarray, errors: np.ndarray) -> list[Pose]:
        twists = twists_of(ROBOT, speeds, fit.values[:3] + values)
        found = [as_pose(fit.starts[0][:3] + start)]
        for index, (ahead, left, turn) in enumerate(errors.reshape(-1, 3)):
            move = as_pose(arcs(ORIGIN, twists[[index]], steps[[index]])[1])
            (here, before), (there, turned) = found[-1], after(found[-1], move)
            middle, way = (here + there) / 2, np.exp(0.5j * (before + turned))
            off = middle + (there - middle) * np.exp(1j * turn) + (ahead + 1j * left) * way
            found.append((off, turned + turn))
        return found

    def read(values: np.ndarray, start: np.ndarray, errors: np.ndarray) -> np.ndarray:
        robot = path(values, start, errors)
        rates = [*np.diff([heading for _, heading in robot]) / steps, 0.0]
        columns = {"yaw_rate": rates}
        for place, beacon in enumerate(PLACES, start=1):
            columns[f"ranges[{place}]"] = [abs(complex(*beacon) - at) for at, _ in robot]
        each = [after(pose, mount) for pose in robot]
        columns |= {"x": [at.real for at, _ in each], "y": [at.imag for at, _ in each]}
        columns["heading"] = [heading for _, heading in each]
        return np.column_stack([columns[name] for name in layout.quantities])[layout.valid[0]]

    none, still = np.zeros(3), np.zeros(3 * len(steps))
    sizes = np.array([fit.noises[group_of(name)].at_rest for name in layout.quantities])
    weight = (1 / np.broadcast_to(sizes, layout.valid[0].shape)[layout.valid[0]])[:, None]
    by_values = weight * slopes(lambda off: read(off, none, still), 3)
    by_start = weight * slopes(lambda off: read(none, off, still), 3)
    by_errors = weight * slopes(lambda off: read(none, none, off), len(still))
    robot = path(none, none, still)
    length, turning = (np.abs(np.diff([pose[part] for pose in robot])) for part in (0, 1))
    solve = np.linalg.pinv(np.hstack([by_values, by_start]))

    def covariance(rates: np.ndarray) -> np.ndarray:
        turns = rates[2] * length + rates[3] * turning
        variances = np.column_stack([rates[0] * length, rates[1] * length, turns]).ravel()
        of_readings = np.eye(len(weight)) + by_errors @ np.diag(variances) @ by_errors.T
        return (solve @ of_readings @ solve.T)[:3, :3]

    return covariance


def require_dense(fit: Fit, sits: Sequence[float]) -> None:
    expected = dense(fit, sits)
    for kind in np.eye(4):
        rates = 1e-4 * kind + 1e-6
        found = drift(fit, DriftRates(rates, np.zeros((4, 4))))
        np.testing.assert_allclose(found.matrix[:3, :3], expected(rates), rtol=1e-4)
        assert found.half_width == pytest.approx(1.96, abs=0.001)


@pytest.mark.slow
@pytest.mark.parametrize("quantities", [("x", "y", "heading"), ("x", "y")], ids=len)
@pytest.mark.parametrize("sits", [ORIGIN, SITS], ids=["centred", "off"])
def test_is_what_full_matrices_say(quantities: tuple[str, ...], sits: tuple[float, float, float]):
    log = log_of(course(seconds=4.0, period=0.4), place=sits, noise=NOISE, quantities=quantities)
    fit = fit_of([log], unknowns_of(sits=sits))
    require_dense(fit, sits)


SENSED = Ranges(beacons=PLACES, noise=0.01), YawRate(noise=0.01, bias="known")


@pytest.mark.slow
def test_further_sensors_have_the_drift_of_what_they_see():
    # Of a gyroscope it is that of each period alone, of ranges all that went before.
    drive = course(seconds=4.0, period=0.4)
    ranges = sighted(drive, "ranges", "r", PLACES, noise=[0.01], rows=np.arange(0, len(drive.times), 2))
    log = with_sensors(drive, ranges, gyro(drive, noise=0.01), noise=(0.01, 0.0), quantities=("x", "y"))
    labelled = tuple((sensor.kind, sensor) for sensor in SENSED)
    layout = cut([log], np.inf, [0.0], labelled)
    require_dense(replace(search_of([log]), layout=layout).fit(), ORIGIN)


def test_segments_drift_apart_from_each_other():
    # Each has a start of its own: what happened before it is no matter.
    log = log_of(course(seconds=6.0), noise=NOISE)
    fit = fit_of([log], seconds=3.0)
    layout, each = fit.layout, []
    for row in range(layout.count):
        one = replace(layout, owner=layout.owner[[row]], times=layout.times[[row]])
        one = replace(one, readings=layout.readings[[row]], valid=layout.valid[[row]])
        own = {"starts": fit.starts[[row]], "by_start": fit.by_start[[row]]}
        each.append(drifting_scores(replace(fit, layout=one, **own)))
    np.testing.assert_allclose(drifting_scores(fit), sum(each), rtol=1e-9)


def test_costs_no_more_than_a_pass_along_the_log():
    times = np.linspace(0.0, 1e3, 50_000)[None]
    path = np.stack([np.cos(times), np.sin(times), times], axis=-1)
    began = time.process_time()
    assert np.isfinite(carried_along(path, np.ones((*path.shape, 3)))).all()
    # A matrix of all readings by all steps would fill 20 gigabytes.
    assert time.process_time() - began < 3.0


class TestRates:
    @pytest.mark.slow
    def test_are_those_of_the_poses_where_other_sensors_read_as_well(self):
        drive = drifting(course(seconds=30.0, seed=1), TRUE, 3 * USUALLY, 1)
        log = with_sensors(drive, gyro(drive, noise=0.01, bias=0.02), noise=NOISE, seed=1)
        poses = logged_problem().sensors[0]
        problem = logged_problem(measurement=Several(sensors=(poses, YawRate(noise=0.01))))
        found, alone = (
            calibrate(one, [read], options(segment=4.0, sensor_place=(), clock_offset=False)).drift
            for one, read in ((problem, log), (logged_problem(), replace(log, sensors=())))
        )
        assert found.seconds == alone.seconds
        np.testing.assert_allclose(found.values, alone.values, rtol=0.1)

    @pytest.mark.slow
    def test_are_those_that_the_robot_drifts_with(self):
        logs = [driven(seed, 30.0, 3.0) for seed in range(3)]
        found = drift_rates(fit_of(logs, seconds=2.0))
        assert found.shown
        assert found.seconds == 4.0
        errors = (np.log(found.values) - 2 * np.log(3 * USUALLY))[[0, 3]]
        assert np.abs(errors / np.sqrt(np.diag(found.spread))[[0, 3]]).max() < 3
        assert np.abs(errors).max() < 0.8

    @pytest.mark.slow
    def test_hang_on_no_more_than_the_residuals(self):
        # Of several logs with a clock each, hardly known before, what a search left of its scores once pulled
        # rates to thousands of times the usual ones.
        found = calibrate(logged_problem(), [driven(31007 + number, 10.0) for number in range(4)]).drift
        assert found.shown
        assert np.abs(np.log(found.values / USUAL)).max() < np.log(3)

    @pytest.mark.slow
    def test_of_too_short_a_log_are_about_the_usual_ones(self):
        found = drift_rates(fit_of([driven(0, 2.0)]))
        assert np.abs(np.log(found.values / USUAL)).max() < 2.5
        assert drift(fit_of([driven(0, 2.0)]), found).degrees < 10

    @pytest.mark.slow
    def test_of_no_drift_are_next_to_nothing_and_said_so(self):
        logs = [
            log_of(course(seconds=30.0, seed=seed), noise=NOISE, seed=seed, name=str(seed)) for seed in (0, 1)
        ]
        found = drift_rates(fit_of(logs))
        assert found.shown is False
        assert np.all(np.sqrt(found.values) < 0.4 * USUALLY)

    def test_of_positions_alone_are_the_usual_ones(self):
        found = drift_rates(fit_of([log_of(course(seconds=8.0), noise=NOISE, quantities=("x", "y"))]))
        np.testing.assert_array_equal(found.values, USUAL)
        assert (found.shown, found.seconds) == (None, None)
        assert found.words.startswith(
            "drift, such as robots usually have: 3.0 mm ahead, 1.0 mm sideways and 0.15 deg"
        )

    @pytest.mark.slow
    def test_far_below_the_usual_ones_show_in_whole_logs_only(self):
        # Windows of seconds call that no drift; it doubles the errors of F^-1.
        factor = 0.05
        logs = [driven(seed, 40.0, factor, period=0.25) for seed in (2, 3)]
        found = drift_rates(fit_of(logs))
        assert found.shown is False
        assert np.all(np.abs(np.log(np.sqrt(found.values) / (factor * USUALLY))) < np.log(2))
        assert "which the logs do not show, taken as large as the noise of poses leaves open" in found.words
        assert said(fit_of(logs)).name == "drift"

    @pytest.mark.slow
    def test_outliers_are_no_drift(self):
        drives = [course(seconds=20.0, seed=seed) for seed in (0, 1)]
        logs = [log_of(one, noise=NOISE, outliers=0.02, name=str(k)) for k, one in enumerate(drives)]
        found = drift_rates(fit_of(logs, loss="huber"))
        assert np.all(np.sqrt(found.values) < 0.6 * USUALLY)


@pytest.mark.slow
def test_residuals_that_grow_less_than_twofold_are_drift_all_the_same():
    # Too little for shorter segments, and much for error bars.
    found = calibrate(logged_problem(), [driven(3, 30.0, 0.15)], options(clock_offset=False, sensor_place=()))
    assert found.segmenting.seconds == np.inf
    assert not found.segmenting.drifts
    assert found.drifts
    assert found.covariances[0].name == "drift"
    assert found.covariances[0].deviations[2] > 2 * found.covariances[-1].deviations[2]


def said(fit: Fit) -> Covariance:
    """What `calibrate` takes for a fit to few logs."""
    rates = drift_rates(fit)
    ways = {one.name: one for one in (information(fit), drift(fit, rates))}
    return ways[most_trusted(ways, blocks_of(fit, None), rates, False, len(TRUE))]


@pytest.mark.slow
def test_whole_logs_say_how_large_errors_are_and_drift_in_what_proportions():
    # Where drift is overrated, as by what passes within seconds, eight logs are not made as unsure.
    fit = fit_of([driven(seed, 5.0) for seed in range(8)], seconds=np.inf)
    found = []
    for size in (1.0, 100.0):
        rates = DriftRates(size * USUAL, np.zeros((4, 4)), True, 2.0)
        ways = covariances_of(fit, options(), rates, drifts=True, seed=0)
        assert ways[0].name == "bootstrap"
        found.append(ways[0])
        # Of the eigenvalues those below their mean, or 1, are raised to it.
        under = next(one for one in ways if one.name == "drift")
        plain = covariances_of(fit, options(covariance="bootstrap"), rates, drifts=True, seed=0)[0]
        assert least_ratio(plain, under) < least_ratio(ways[0], under)
    assert np.all(found[1].deviations < 1.5 * found[0].deviations)


class TestLeastDegrees:
    """Single variances may be surer than those of combinations, in which one part is all there is."""

    @staticmethod
    def fit() -> tuple[Fit, Covariance]:
        fit = fit_of([driven(seed, 10.0) for seed in (1, 2)], seconds=np.inf)
        return fit, drift(fit, DriftRates(0.01 * USUAL, np.diag([0.5, 0.1, 1.0, 2.0])))

    def test_are_those_of_the_least_sure_eigenvector(self):
        fit, found = self.fit()
        parts = drifting_scores(fit) * (0.01 * USUAL)[:, None, None]
        sizes = found.deviations[:3]
        _, vectors = np.linalg.eigh(found.matrix[:3, :3] / np.outer(sizes, sizes))
        expected = []
        for way in (*np.eye(3), *vectors.T):
            along = fit.response[:, :3] @ (way / sizes)
            shares = np.array([along @ part @ along for part in parts])
            shares /= way @ (found.matrix[:3, :3] / np.outer(sizes, sizes)) @ way
            expected.append(degrees_of(float(shares @ np.diag([0.5, 0.1, 1.0, 2.0]) @ shares)))
        assert found.degrees == pytest.approx(min(expected[:3]))
        assert found.degrees_together == pytest.approx(min(expected))
        assert found.degrees_together < 0.9 * found.degrees
        assert found.half_width_together > found.half_width

    def test_without_others_are_as_of_single_ones(self):
        one = Covariance(np.eye(2), 7.0, "bootstrap")
        assert one.degrees_together == 7.0
        assert one.half_width_together == one.half_width


def least_ratio(one: Covariance, other: Covariance) -> float:
    """The least standard error of a combination of parameters, in units of the other's."""
    mine, its = (each.matrix[: len(TRUE), : len(TRUE)] for each in (one, other))
    return float(np.sqrt(scipy.linalg.eigh(mine, its, eigvals_only=True)[0]))


class TestFewBlocks:
    """Ten blocks of two logs disagree in hardly more directions than there are unknowns."""

    @staticmethod
    def found(**keys: str) -> Calibration:
        logs = [driven(seed, 10.0) for seed in (29007, 29008)]
        return calibrate(logged_problem(), logs, options(method="gls", **keys))

    @pytest.mark.slow
    def test_a_bootstrap_that_is_trusted_is_nowhere_surer_than_drift(self):
        found = self.found()
        ways = {one.name: one for one in found.covariances}
        assert found.covariances[0].name == "bootstrap"
        assert least_ratio(ways["bootstrap"], ways["drift"]) == pytest.approx(1.0, abs=1e-6)
        assert not any(one.name == "few_blocks" for one in found.doubts)

    @pytest.mark.slow
    def test_one_that_is_asked_for_is_what_it_is_and_doubted(self):
        found = self.found(covariance="bootstrap")
        ways = {one.name: one for one in found.covariances}
        assert least_ratio(ways["bootstrap"], ways["drift"]) < 0.3
        (doubt,) = (one for one in found.doubts if one.name == "few_blocks")
        assert "standard errors 16 % of those under drift" in doubt.message


SETS = 20
"""Of logs, each with errors of its own."""
Misses = tuple[np.ndarray, np.ndarray]
"""Errors (sets, p), and covariances (sets, p, p) by which 1.96 standard errors are half an interval."""


def misses(logs: Callable[[int], list[Log]], seconds: float, count: int = SETS) -> tuple[Misses, Misses]:
    """Of so many sets: as `calibrate` takes them, and of F^-1."""
    nothing = loosely(unknowns_of())
    fits = [fit_of(logs(seed), seconds=seconds, known=nothing) for seed in range(count)]
    errors = np.array([fit.values - TRUE for fit in fits])
    return (errors, halved(fits, said)), (errors, halved(fits, information))


def halved(fits: Sequence[Fit], way: Callable[[Fit], Covariance]) -> np.ndarray:
    each = map(way, fits)
    return np.array([one.matrix * (one.half_width / 1.96) ** 2 for one in each])


def held(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """How many intervals hold the truth, (p,)."""
    reach = 1.96 * np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    return np.sum(np.abs(errors) < reach, axis=0)


@pytest.mark.slow
class TestCoverage:
    """By the sizes of all errors, of which fewer sets say as much as shares of intervals do."""

    def test_two_short_logs(self):
        own, white = misses(lambda seed: [driven(10 * seed + k, 5.0) for k in range(2)], np.inf)
        require_pulls(*own)
        assert held(*own).min() >= fewest_held(SETS)
        assert held(*white).max() < 0.6 * SETS

    def test_a_single_log_of_circles_in_one_direction(self):
        times = 0.2 * np.arange(150)
        wheels = np.column_stack([4 + 0.4 * np.sin(0.4 * times), 2.5 + 0.25 * np.sin(0.23 * times)])
        own, white = misses(lambda seed: [driven(seed, 30.0, inputs=wheels, period=0.2)], 4.0)
        require_pulls(*own)
        assert held(*own).min() >= fewest_held(SETS)
        assert held(*white).max() < 0.6 * SETS

    def test_no_drift_at_all(self):
        for one in misses(lambda seed: [driven(seed, 50.0, 0.0, period=0.5)], np.inf):
            require_pulls(*one)
            assert held(*one).min() >= fewest_held(SETS)

    def test_drift_that_no_window_shows(self):
        own, white = misses(lambda seed: [driven(seed, 80.0, 0.03, period=0.5)], np.inf)
        require_pulls(*own)
        assert held(*own).min() >= fewest_held(SETS)
        assert held(*white).max() < 0.8 * SETS
