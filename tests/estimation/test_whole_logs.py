"""Whole logs by likelihood: information under all that errs, sizes of that, and what estimates come to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy
from builders import problem_of, random_drive
from pulls import require_pulls
from simulated import (
    ORIGIN,
    ROBOT,
    TRUTH,
    arcs,
    course,
    fit_of,
    lasting,
    log_of,
    logged_problem,
    loosely,
    options,
    truth_of,
    twists_of,
    unknowns_of,
)
from windowed import drifting

from oed.estimation import calibrate
from oed.estimation.assessment.diagnostics import diagnostics
from oed.estimation.methods.drift_rates import DriftRates
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.log_errors import DRIFT, LASTING, PASSING, SIZES, ErrorSizes, drift_shows
from oed.estimation.methods.nonlinear import Nonlinear
from oed.estimation.methods.whole_logs import Likeliest, WholeLogs, whole_issue
from oed.foundation.errors import ProblemError
from oed.kernel.criteria import E
from oed.logs.log import Log
from oed.records.calibration_outcome import estimate_of
from oed.report.estimate import write_estimate
from oed.report.estimate.fit import error_bars
from oed.robots.models import SkidSteerSlip
from oed.robots.sensors import Poses
from oed.robots.sensors.drift import AT_REST, Drift
from oed.robots.sensors.poses import AbsoluteNoise
from oed.workflow.estimate_logs import estimate
from oed.workflow.studies import parse_study

TRUE = truth_of(ROBOT, **TRUTH)
NOISE = (0.0005, 0.003)
SITS = (0.1, -0.05, 0.2)
ERRORS = {
    "position": 0.0005,
    "heading": 0.003,
    "passing_ahead": 0.002,
    "passing_sideways": 0.001,
    "passing_heading": 0.01,
    "passing_seconds": 1.5,
    "lasting_position": 0.003,
    "lasting_heading": 0.005,
    "lasting_seconds": 4.0,
    "ahead": 0.004,
    "sideways": 0.002,
    "turn_by_path": 0.003,
    "turn_by_turning": 0.008,
}
USUALLY = (0.003, 0.001, np.radians(0.15), np.radians(0.4))


def known(**sizes: float) -> ErrorSizes:
    """All sizes known, those named otherwise than `ERRORS`."""
    return ErrorSizes.of({"position": 1.0, "heading": 1.0}, 1.0).known({**ERRORS, **sizes})


def slopes(what: Callable[[np.ndarray], np.ndarray], size: int) -> np.ndarray:
    """Derivatives at 0 by differences, (n, size)."""
    units = 1e-6 * np.eye(size)
    return np.column_stack([(what(unit) - what(-unit)) / 2e-6 for unit in units])


def dense(fit: Fit, sits: tuple[float, float, float], sizes: dict[str, float]) -> np.ndarray:
    """Covariance (3, 3) of generalised least squares of a whole log, its readings' covariance written out in
    full, by difference quotients of arcs.
    """
    (log,), times = fit.layout.logs, fit.layout.times[0]
    steps = np.diff(times)
    speeds = np.diff(log.integrals_at(times, 0.0), axis=0) / steps[:, None]

    def path(values: np.ndarray, start: np.ndarray, errors: np.ndarray) -> np.ndarray:
        twists = twists_of(ROBOT, speeds, fit.values[:3] + values)
        begin = fit.starts[0][:3] + start
        return arcs(begin, twists + errors.reshape(-1, 3) / steps[:, None], steps)

    def read(values: np.ndarray, start: np.ndarray, errors: np.ndarray) -> np.ndarray:
        states = path(values, start, errors)
        cosine, sine = np.cos(states[:, 2]), np.sin(states[:, 2])
        x = states[:, 0] + sits[0] * cosine - sits[1] * sine
        y = states[:, 1] + sits[0] * sine + sits[1] * cosine
        return np.column_stack([x, y, states[:, 2] + sits[2]]).ravel()

    none, still, count = np.zeros(3), np.zeros(3 * len(steps)), len(times)
    by_values = slopes(lambda off: read(off, none, still), 3)
    by_start = slopes(lambda off: read(none, off, still), 3)
    by_errors = slopes(lambda off: read(none, none, off), len(still))
    twists = twists_of(ROBOT, speeds, fit.values[:3])
    length = np.hypot(twists[:, 0], AT_REST) * steps
    turning = np.hypot(twists[:, 2], AT_REST) * steps
    turn = sizes["turn_by_path"] ** 2 * length + sizes["turn_by_turning"] ** 2 * turning
    drift = np.column_stack([sizes["ahead"] ** 2 * length, sizes["sideways"] ** 2 * length, turn]).ravel()
    apart = np.abs(times[:, None] - times)
    passes, lasts = np.exp(-apart / sizes["passing_seconds"]), np.exp(-apart / sizes["lasting_seconds"])
    white = np.array([sizes["position"], sizes["position"], sizes["heading"]]) ** 2
    stays = np.array([sizes["lasting_position"]] * 2 + [sizes["lasting_heading"]]) ** 2
    # What passes, in the robot's frame, of which the heading is made by turning and forgotten on the way.
    decay = np.exp(-(times[:, None] - times[:-1] - steps) / sizes["passing_seconds"])
    decay = np.where(times[:, None] > times[:-1], decay, 0.0)
    heading = (decay * sizes["passing_heading"] ** 2 * turning) @ decay.T
    headings = path(none, none, still)[:, 2]
    turned = np.zeros((count, 3, count, 3))
    for row in range(count):
        turned[row, :, row] = np.eye(3)
        cosine, sine = np.cos(headings[row]), np.sin(headings[row])
        turned[row, :2, row, :2] = [[cosine, -sine], [sine, cosine]]
    turned = turned.reshape(3 * count, 3 * count)
    places = np.zeros((count, 3, count, 3))
    places[:, 0, :, 0] = sizes["passing_ahead"] ** 2 * passes
    places[:, 1, :, 1] = sizes["passing_sideways"] ** 2 * passes
    places[:, 2, :, 2] = heading
    whole = by_errors @ np.diag(drift) @ by_errors.T
    whole += turned @ places.reshape(3 * count, -1) @ turned.T
    whole += np.kron(lasts, np.diag(stays)) + np.kron(np.eye(count), np.diag(white))
    columns = np.hstack([by_values, by_start])
    return np.linalg.inv(columns.T @ np.linalg.solve(whole, columns))[:3, :3]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("some", "sits"),
    [("all", ORIGIN), *((some, SITS) for some in ("all", "passing", "lasting", "drift"))],
    ids=["centred", "all", "passing", "lasting", "drift"],
)
def test_information_is_what_full_matrices_say(some: str, sits: tuple[float, float, float]):
    # Of each kind alone the others are next to nothing, so that none hides behind another.
    kinds = {"passing": PASSING[:3], "lasting": LASTING[:2], "drift": DRIFT}
    small = {name: 1e-9 for kind, names in kinds.items() if some not in ("all", kind) for name in names}
    log = log_of(course(seconds=6.0, period=0.3), place=sits, noise=NOISE)
    fit = fit_of([log], unknowns_of(sits=sits))
    found = WholeLogs(fit, together=1).planned({**ERRORS, **small})
    np.testing.assert_allclose(found, dense(fit, sits, {**ERRORS, **small}), rtol=1e-5)


@pytest.mark.slow
def test_slopes_of_the_likelihood_are_its_differences():
    logs = [log_of(course(seconds=4.0, seed=seed), noise=NOISE, name=str(seed)) for seed in (0, 1)]
    fit = fit_of(
        logs,
        unknowns_of(place=("sensor_x",), clocks=2),
        known=loosely(unknowns_of(place=("sensor_x",), clocks=2)),
    )
    search, errors = WholeLogs(fit), ErrorSizes.of({"position": 0.001, "heading": 0.002}, 4.0)
    linear, logs_of = search._iterate(fit.values, search._first_paths).linear, errors.guess + 0.1
    _, slope = linear.surprise(errors, logs_of)
    for place in range(len(SIZES)):
        off = 1e-4 * np.eye(len(SIZES))[place]
        both = [linear.surprise(errors, logs_of + way * off)[0] for way in (1, -1)]
        assert slope[place] == pytest.approx((both[0] - both[1]) / 2e-4, rel=1e-5, abs=1e-4)


@pytest.mark.slow
def test_the_likelihood_of_exact_readings_falls_with_the_sizes_of_their_noise():
    # White noise alone, of which readings show nothing: what is left are the readings less the unknowns.
    fit = fit_of([log_of(course(seconds=6.0, period=0.3))])
    search, none = WholeLogs(fit, together=1), dict.fromkeys((*PASSING[:3], *LASTING[:2], *DRIFT), 1e-9)
    linear = search._iterate(fit.values, search._first_paths).linear
    small, large = (known(**none, position=0.001 * size, heading=0.002 * size) for size in (1.0, 3.0))
    rise = linear.surprise(large, large.guess)[0] - linear.surprise(small, small.guess)[0]
    freedom = fit.layout.valid.sum() - len(fit.values) - 3
    assert rise == pytest.approx(2 * np.log(3.0) * freedom, rel=1e-3)


@pytest.mark.parametrize(
    ("odds", "shows"), [(0.5, True), (2.0, None), (900.0, None), (1100.0, False)], ids=str
)
def test_odds_of_a_thousand_to_one_leave_no_doubt(odds: float, shows: bool | None):
    assert drift_shows(2 * np.log(odds)) is shows


def test_headings_go_on_from_segment_to_segment_where_a_robot_turns_by_more_than_half_a_turn_a_reading():
    times = 0.05 * np.arange(400)
    inputs = np.column_stack([9 + np.sin(times), np.cos(1.3 * times) - 7])
    log = log_of(course(inputs=inputs, period=0.05), noise=NOISE, rows=np.arange(0, 401, 20))
    assert np.diff(log.poses[:, 2]).min() > np.pi
    (path,) = WholeLogs(fit_of([log], seconds=4.0), together=1)._first_paths
    np.testing.assert_allclose(np.diff(path[:, 2]), np.diff(log.poses[:, 2]), atol=0.1)


@pytest.mark.slow
def test_when_a_log_begins_makes_no_difference():
    log = driven(0, 8.0)
    later = replace(log, input_times=log.input_times + 1e3, pose_times=log.pose_times + 1e3)
    first, second = found_in_8_seconds(), WholeLogs(fit_of([later], seconds=4.0)).found()
    np.testing.assert_allclose(second.logs, first.logs, rtol=1e-4, atol=1e-4)


@pytest.mark.slow
def test_readings_taken_together_say_nearly_as_much():
    # Means of two, at the place of their first.
    fit = fit_of([log_of(course(seconds=20.0), noise=NOISE)])
    each, pairs = (np.diag(WholeLogs(fit, together=count).planned(ERRORS)) for count in (1, 2))
    np.testing.assert_allclose(pairs, each, rtol=0.1)


def test_means_see_of_a_steps_drift_what_a_random_walk_has_of_it():
    fit = fit_of([log_of(course(seconds=20.0), noise=NOISE)])
    search = WholeLogs(fit, together=5)
    (stretch,) = search._steps.about(fit.values, search._first_paths)
    # Without the last one, which may be of fewer.
    share, besides = stretch.within[:-1].reshape(-1, 2).T
    walks = np.random.default_rng(0).normal(size=(50_000, 5)).cumsum(axis=1) / np.sqrt(5)
    ends = walks[:, -1]
    # Five readings from the step's begin on, of which the walk is none at the first.
    means = np.column_stack([np.zeros(len(walks)), walks[:, :4]]).mean(axis=1)
    wanted = (means @ ends) / (ends @ ends)
    np.testing.assert_allclose(share, wanted, atol=0.01)
    np.testing.assert_allclose(besides, np.std(means - wanted * ends), rtol=0.02)


@pytest.mark.slow
def test_many_readings_taken_together_say_no_more_than_each():
    # Of 50 in a second the robot drifts by more within a step than what their mean is sure of.
    drift = {**dict.fromkeys((*PASSING[:3], *LASTING[:2]), 1e-9), **dict(zip(DRIFT, USUALLY, strict=True))}
    fit = fit_of([log_of(course(seconds=20.0, period=0.02), noise=NOISE)])
    each = np.sqrt(np.diag(WholeLogs(fit, together=1).planned({**ERRORS, **drift})))
    for count, share in ((8, 0.02), (25, 0.05)):
        some = np.sqrt(np.diag(WholeLogs(fit, together=count).planned({**ERRORS, **drift})))
        np.testing.assert_allclose(some, each, rtol=share)


@pytest.mark.slow
def test_a_robot_may_turn_by_more_than_half_a_turn_between_poses():
    drive = drifting(course(seconds=80.0, period=0.1, seed=2), TRUE, np.array(USUALLY), 2)
    log = log_of(drive, noise=NOISE, every=20, seed=2)
    assert np.abs(np.diff(log.poses[:, 2])).max() > np.pi
    found = WholeLogs(fit_of([log], seconds=4.0)).found()
    assert found.fit.converged
    assert np.abs((found.fit.values - TRUE) / np.sqrt(np.diag(found.covariance))).max() < 3.5


def driven(seed: int, seconds: float, factor: float = 1.0, errs: tuple[float, float] | None = None) -> Log:
    """A log of a robot that drifts `factor` times as far as usual, with errors that last of a size [m] for
    some seconds.
    """
    drive = course(seconds=seconds, seed=seed, period=0.2)
    log = log_of(
        drifting(drive, TRUE, factor * np.array(USUALLY), seed), noise=NOISE, seed=seed, name=str(seed)
    )
    return log if errs is None else lasting(log, *errs, seed=seed)


@cache
def found_in_8_seconds() -> Likeliest:
    return WholeLogs(fit_of([driven(0, 8.0)], seconds=4.0)).found()


@pytest.mark.slow
def test_a_path_far_off_dead_reckoning_is_found():
    # After 40 s the heading is off by some 20 degrees: errors are linear about the path driven only.
    fit = fit_of([driven(0, 40.0, 12.0)], seconds=4.0)
    found = WholeLogs(fit).found()
    assert found.fit.converged
    off = (found.fit.values - TRUE) / np.sqrt(np.diag(found.covariance))
    assert np.abs(off).max() < 3.5
    sizes = np.array([found.sizes[name] for name in DRIFT])
    assert np.all(np.abs(np.log(sizes / (12 * np.array(USUALLY))))[[0, 1, 3]] < 0.5)


def test_errors_of_robots_with_further_states_are_not_separated():
    lagging = SkidSteerSlip(wheel_radius=0.05, track=0.2, yaw_lag=0.3)
    fit = fit_of([log_of(course())])
    assert whole_issue(fit) is None
    found = whole_issue(replace(fit, unknowns=unknowns_of(lagging))) or ""
    assert found.startswith("likelihood is of robots without states beside their pose")


@pytest.mark.slow
def test_sizes_are_those_of_what_errs():
    fit = fit_of([driven(seed, 24.0, 1.0, (0.006, 3.0)) for seed in range(2)], seconds=4.0)
    found = WholeLogs(fit).found()
    spread = dict(zip(SIZES, np.sqrt(np.diag(found.spread)), strict=True))
    true = {
        "heading": NOISE[1],
        "lasting_position": 0.006,
        "lasting_seconds": 3.0,
        **dict(zip(DRIFT, USUALLY, strict=True)),
    }
    for name, size in true.items():
        assert abs(np.log(found.sizes[name] / size)) < 3.5 * spread[name], name


@pytest.mark.slow
def test_drift_shows_where_there_is_some():
    drifting_, still = (
        WholeLogs(fit_of([driven(0, 24.0, factor)], seconds=4.0)).found() for factor in (2.0, 0.0)
    )
    assert drifting_.drifts is True
    assert still.drifts is not True
    variances = [drifting_.sizes[name] ** 2 for name in DRIFT]
    np.testing.assert_allclose(DriftRates.of_whole_logs(drifting_).values, variances)
    assert DriftRates.of_whole_logs(still).words.startswith(
        "drift, as whole logs leave it open beside all else"
    )


@pytest.mark.slow
def test_standard_errors_are_those_of_the_estimates():
    # Of 6 logs all three errors together are known to 17 %.
    off, covariances, held = [], [], []
    for seed in range(6):
        log = driven(seed, 25.0, 1.0, (0.004, 6.0))
        found = WholeLogs(fit_of([log], seconds=4.0, known=loosely(unknowns_of()))).found()
        assert found.fit.converged
        off.append(found.fit.values - TRUE)
        covariances.append(found.covariance)
        reach = scipy.stats.t.ppf(0.975, found.degrees) * np.sqrt(np.diag(found.covariance))
        held.append(np.abs(off[-1]) < reach)
    require_pulls(np.array(off), covariances)
    assert np.mean(held) > 0.88


@pytest.mark.slow
def test_refuses_what_it_is_not_for():
    few = {"method": "likelihood", "sensor_place": (), "clock_offset": False}
    logs = [log_of(course(seconds=5.0), noise=NOISE, quantities=("x", "y"))]
    with pytest.raises(
        ProblemError, match="likelihood is of x, y and heading; the logs hold x, y: use joint"
    ):
        calibrate(logged_problem(), logs, options(**few))
    logs = [log_of(course(seconds=5.0), noise=NOISE)]
    with pytest.raises(ProblemError, match="F\\^-1 of all that errs: omit it"):
        calibrate(logged_problem(), logs, options(**few, covariance="bootstrap"))
    with pytest.raises(ProblemError, match="likelihood takes whole logs: omit it"):
        calibrate(logged_problem(), logs, options(**few, segment=5.0))


@pytest.mark.slow
def test_logs_whose_noise_lasts_are_not_refused():
    # Other methods find by themselves that it does.
    logs = [
        lasting(
            log_of(course(seconds=20.0, seed=seed, period=0.25), noise=NOISE, name=str(seed)), 0.01, 5.0, seed
        )
        for seed in (0, 1)
    ]
    few = {"sensor_place": (), "clock_offset": False}
    assert calibrate(logged_problem(), logs, options(**few)).fit.correlated is not None
    found = calibrate(logged_problem(), logs, options(method="likelihood", **few))
    assert found.log_errors.sizes["lasting_position"] == pytest.approx(0.01, rel=0.5)
    with pytest.raises(ProblemError, match="looks for errors that last itself, not noise: correlated"):
        calibrate(logged_problem(), logs[:1], options(method="likelihood", noise="correlated", **few))


@pytest.mark.slow
def test_says_what_errs():
    asked = options(method="likelihood", sensor_place=(), clock_offset=False)
    found = calibrate(logged_problem(), [driven(0, 10.0, 3.0)], asked)
    assert found.covariances[0].name == "information"
    assert found.log_errors is not None
    assert found.drift.words.startswith("drift, as whole logs show it beside all else that errs: ")
    assert [one.name for one in found.diagnostics] == ["whiteness", "outliers"] * 2
    assert found.fit.layout.count == 1


@pytest.mark.slow
def test_what_the_study_states_is_said_to_be_stated():
    found = calibrate(logged_problem(), [driven(0, 8.0)], options(method="likelihood", noise="specified"))
    assert {name for name, size in found.log_errors.sizes.items() if not size} == {*PASSING, *LASTING}
    (table,) = (
        one for one in error_bars(estimate_of(found)).tables if one.columns[-1].title == "95 % interval"
    )
    assert [row[0] for row in table.rows] == ["noise of readings"] * 2 + ["drift"] * 4
    assert [row[-1] == "as specified" for row in table.rows] == [True] * 2 + [False] * 4


@pytest.mark.slow
def test_innovations_that_are_correlated_are_no_error_that_is_allowed_for():
    fit = found_in_8_seconds().fit
    # Sums of each and the one before, as large as each: at a level of 0.1 % it would not be said.
    white = (fit.white + np.roll(fit.white, 1, axis=1)) / np.sqrt(2)
    found = diagnostics(replace(fit, white=white), {})
    said = [one.message for one in found if one.name == "whiteness" and not one.passed]
    assert said
    assert all("not all that errs is in the model" in one and "allowed for" not in one for one in said)


@pytest.mark.slow
def test_maximises_the_likelihood_that_designs_are_simulated_with():
    # The same readings, of a drive that was planned, and of a log of it.
    drift = Drift(
        ahead_per_metre=0.01, sideways_per_metre=0.004, heading_per_metre=0.02, heading_per_radian=0.03
    )
    sensor = Poses(noise=AbsoluteNoise(position=NOISE[0], heading=NOISE[1]), drift=drift)
    problem = problem_of(measurement=sensor, criterion=E())
    drive = random_drive(problem, 3)
    planned = Nonlinear(problem, drive)
    readings, _ = planned._readings.simulated(np.random.default_rng(0))
    expected = planned.fit(readings)
    times = drive.period * np.arange(drive.samples + 1)
    turned = np.vstack([np.zeros(2), np.cumsum(drive.period * drive.inputs, axis=0)])
    poses = readings.reshape(-1, 3)
    log = Log("drive", "drive", times, turned, times[-len(poses) :], poses)
    fit = fit_of([log], unknowns_of(problem.model), seconds=2.0)
    stated = ErrorSizes.specified({"position": NOISE[0], "heading": NOISE[1]}, drift)
    found = WholeLogs(fit, stated, together=1).found()
    # Drift grows with the motion at the values found here, at nominal ones there.
    errors = np.sqrt(np.diag(expected.covariance))
    assert np.all(np.abs(found.fit.values - expected.values) < 0.01 * errors)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=0.02)
    assert DriftRates.of_whole_logs(found).words.startswith("drift, as the study specifies it: ")


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
def test_the_page_says_what_errs_and_how_sure_that_is(tmp_path):
    study = parse_study(
        "format: 1\nname: Drifting\nrobot: {kind: differential_drive, wheel_radius: 5 cm, track: 20 cm}\n"
        "measurement: {kind: poses, noise: {position: 2 mm, heading: 0.3 deg}}\n"
        "calibration: {method: likelihood, sensor_place: [], clock_offset: false}\n"
    )
    log, rows = driven(0, 10.0), []
    held = np.vstack([log.inputs_between(log.pose_times), np.zeros(2)])
    for time, inputs, pose in zip(log.pose_times, held, log.poses, strict=True):
        rows.append(",".join(map(str, [time, *inputs, *pose])))
    table = "t,wheel_speed_right,wheel_speed_left,x,y,heading\n" + "\n".join(rows) + "\n"
    (tmp_path / "log.csv").write_text(table)
    found = estimate(study, [tmp_path / "log.csv"])
    assert [one.name for one in found.log_errors] == list(SIZES)
    assert all(one.interval[0] <= one.size <= one.interval[1] for one in found.log_errors)
    text = (write_estimate(found, tmp_path).parent / "estimate.md").read_text()
    assert "estimated by the likelihood of whole logs" in text
    assert "Standard errors are those of F⁻¹ under drift" in text
    assert "| noise of readings | position |" in text
    assert "| drift | heading, after 1 rad of turning |" in text
