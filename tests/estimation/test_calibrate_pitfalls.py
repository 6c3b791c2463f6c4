"""Traps that logs set: each was fallen into once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated import ROBOT, TRUTH, by_name, course, log_of, logged_problem, options, several, truth_of

from oed.estimation import calibrate
from oed.estimation.preprocessing.moves import Moves
from oed.estimation.preprocessing.preprocess import preprocess
from oed.estimation.preprocessing.wiring_checks import frozen
from oed.estimation.setup.unknowns import specified_mount
from oed.foundation.errors import LogError
from oed.kernel.dynamics.system import Parameter
from oed.robots.models import OmniThree
from oed.robots.sensors import Poses
from oed.robots.sensors.logged import Noise
from oed.robots.sensors.mounting import LeverArm
from oed.robots.sensors.poses import AbsoluteNoise

NOISE = (0.002, 0.005)
OMNI = OmniThree(wheel_radius=0.04, centre_distance=0.18)
TRUE = np.array([*TRUTH.values()])


@pytest.mark.slow
def test_a_sensor_that_looks_backwards():
    log = log_of(course(seconds=8.0), noise=NOISE, place=(0.1, -0.05, np.pi - 0.1))
    found = calibrate(logged_problem(), [log], options(segment="log", clock_offset=False))
    np.testing.assert_allclose(found.values, TRUE, rtol=0.01)
    assert by_name(found.fit)["sensor_heading"] == pytest.approx(np.pi - 0.1, abs=0.01)
    assert not any(one.doubtful for log in found.logs for one in log.findings)


@pytest.mark.slow
def test_wheels_of_other_sizes_on_a_gentle_turn_are_not_exchanged_wheels():
    inputs = np.tile([3.6, 4.0], (200, 1)) * (1 + 0.1 * np.sin(np.arange(200) / 9))[:, None]
    drive = course(parameters=np.array([0.06, 0.05, 0.2]), inputs=inputs)
    preprocess(ROBOT, [log_of(drive, noise=NOISE)], compare_clocks=True)


@pytest.mark.slow
def test_too_few_poses_for_the_unknowns():
    log = log_of(course(seconds=10.0))
    few = replace(log, pose_times=log.pose_times[[0, 100]], poses=log.poses[[0, 100]])
    with pytest.raises(LogError, match="6 readings cannot identify 10 unknowns; log more poses"):
        calibrate(logged_problem(), [few], options(segment="log"))


def test_logs_apart_have_to_be_alike():
    log = log_of(course(seconds=6.0), noise=NOISE)
    places = replace(log, file="places.csv", poses=log.poses[:, :2], quantities=("x", "y"))
    with pytest.raises(LogError, match=r"places\.csv: holds x, y, .* x, y, heading"):
        calibrate(logged_problem(), [log], options(segment="log"), test_logs=[log, places])


@pytest.mark.slow
def test_one_log_that_drifts_has_wide_error_bars():
    # How wide they have to be no single log can tell: drift that lasts as long as the log looks like a wheel.
    log = log_of(course(seconds=60.0, period=0.2, drift=0.001), noise=NOISE)
    found = calibrate(logged_problem(), [log], options(sensor_place=(), clock_offset=False))
    errors = {one.name: one.deviations[:3] for one in found.covariances}
    assert next(iter(errors)) in ("drift", "bootstrap")
    assert np.all(errors["drift"] > 2 * errors["information"])
    assert np.all(errors["bootstrap"] > 2 * errors["information"])


@pytest.mark.slow
def test_logs_are_blocks_by_themselves_where_there_are_enough():
    asked = options(segment=2.0, replicates=100, noise="constant", sensor_place=(), clock_offset=False)
    scores = []
    for seed in range(5):
        logs = several(10, seconds=6.0, noise=NOISE, seed=100 * seed, drift=0.003)
        found = calibrate(logged_problem(), logs, asked)
        bootstrap = next(one for one in found.covariances if one.name == "bootstrap")
        assert bootstrap.degrees == 9
        scores.append((found.values - TRUE) / bootstrap.deviations[:3])
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 2.2


@pytest.mark.slow
def test_a_short_log_that_drifts_has_error_bars_of_drift():
    log = log_of(course(seconds=3.5, drift=0.05), noise=(0.0002, 0.0005))
    found = calibrate(logged_problem(), [log])
    assert found.segmenting.drifts
    assert found.drifts
    drift, information = found.covariances
    assert (drift.name, information.name) == ("drift", "information")
    assert np.all(drift.deviations[:3] > 1.3 * information.deviations[:3])


@pytest.mark.slow
def test_of_few_windows_drift_is_judged_by_what_is_usual():
    chosen = options(method="two_stage", block=5.0, clock_offset=False, sensor_place=())
    logs = [log_of(course(seconds=seconds), noise=(0.0002, 0.0005)) for seconds in (10.0, 80.0)]
    (drift, information), more = (calibrate(logged_problem(), [one], chosen).covariances for one in logs)
    assert [drift.name, information.name] == ["drift", "information"]
    assert np.all(drift.deviations > information.deviations)
    # Two windows show less of a variance than sixteen.
    (of_more,) = [one for one in more if one.name == "drift"]
    assert 4 < drift.degrees < of_more.degrees


@pytest.mark.parametrize(
    ("arm", "sits", "fixed"),
    [
        (LeverArm(), (0.0, 0.0, 0.0), False),
        (LeverArm(known=True), (0.0, 0.0, 0.0), False),
        (LeverArm(x=0.1), (0.1, 0.0, 0.0), True),
        (LeverArm(x=0.1, known=False, deviation=0.01), (0.1, 0.0, 0.0), False),
    ],
)
def test_the_sensor_sits_where_the_study_says(arm, sits, fixed):
    mount = specified_mount(Poses(noise=AbsoluteNoise(position=0.01, heading=0.01), lever_arm=arm))
    assert (mount.sits, mount.fixed) == (sits, fixed)
    assert mount.deviations == ({"sensor_x": 0.01, "sensor_y": 0.01} if arm.deviation else {})


@pytest.mark.slow
def test_an_arm_roughly_known_is_estimated_from_there():
    measurement = Poses(
        noise=AbsoluteNoise(position=0.002, heading=0.005),
        lever_arm=LeverArm(x=0.08, y=-0.05, known=False, deviation=0.05),
    )
    log = log_of(course(seconds=6.0), noise=NOISE, place=(0.1, -0.05, 0.0))
    asked = options(segment="log", clock_offset=False)
    found = calibrate(logged_problem(measurement=measurement), [log], asked)
    assert by_name(found.fit)["sensor_x"] == pytest.approx(0.1, abs=0.003)


@pytest.mark.slow
def test_error_bars_of_a_robust_loss_agree_where_the_noise_is_white():
    logs = several(10, seconds=3.0, noise=NOISE)
    asked = options(segment="log", loss="cauchy", replicates=500, sensor_place=(), clock_offset=False)
    found = calibrate(logged_problem(), logs, asked)
    errors = {one.name: one.deviations[:3] for one in found.covariances}
    assert found.fit.bend < 0.8
    assert errors["bootstrap"] == pytest.approx(errors["information"], rel=0.5)


def test_what_only_the_prior_tells_stays_as_open_as_the_prior():
    from oed.estimation.setup.unknowns import inverse_of_sum

    told, known = np.diag([1e18, 0.0]), np.diag([1.0, 4.0])
    np.testing.assert_allclose(np.diag(inverse_of_sum(told, known)), [1e-18, 0.25], rtol=1e-9)


@pytest.mark.slow
def test_noise_grows_only_where_it_is_looked_for():
    log = log_of(course(seconds=5.0), noise=NOISE)
    asked = options(segment="log", noise="constant", sensor_place=(), clock_offset=False)
    found = calibrate(logged_problem(), [log], asked)
    assert all(isinstance(one, Noise) and one.per_speed == 0 for one in found.fit.noises.values())


@pytest.mark.slow
@pytest.mark.parametrize("method", ["joint", "gls", "two_stage"])
def test_what_is_known_of_the_sensors_place_counts_once(method):
    def sensor_x(arm: LeverArm) -> tuple[float, float]:
        measurement = Poses(noise=AbsoluteNoise(position=0.002, heading=0.005), lever_arm=arm)
        asked = options(method=method, segment=2.0, noise="constant", clock_offset=False)
        found = calibrate(logged_problem(measurement=measurement), logs, asked)
        place = found.fit.unknowns.names.index("sensor_x")
        return found.fit.values[place], float(np.sqrt(found.fit.inverse[place, place]))

    logs = several(2, seconds=8.0, noise=NOISE)
    value, error = sensor_x(LeverArm(x=0.001, known=False))
    # Knowledge as sure as the logs, and one standard error away, moves the estimate by half of it.
    moved, narrower = sensor_x(LeverArm(x=value + error, known=False, deviation=error))
    assert (moved - value) / error == pytest.approx(0.5, abs=0.12)
    assert narrower / error == pytest.approx(np.sqrt(0.5), rel=0.1)


def test_poses_in_another_unit_are_refused():
    log = log_of(course(seconds=10.0), noise=NOISE)
    wide = replace(log, poses=log.poses * [1000.0, 1000.0, 1.0])
    with pytest.raises(LogError, match=r"drive\.csv: .*1e\+03 times .* in mm; give x and y unit"):
        calibrate(logged_problem(), [wide], options(segment="log"))


@pytest.mark.parametrize("still", [[0, 1, 2], [0, 1], [2]], ids=["all", "positions", "heading"])
def test_poses_that_never_move_are_refused(still: list[int]):
    log = log_of(course(seconds=10.0), noise=NOISE)
    for noise in (0.0, 1e-9, 1e-3):
        poses = log.poses.copy()
        poses[:, still] = noise * np.random.default_rng(0).standard_normal((len(poses), len(still)))
        with pytest.raises(LogError, match=r"drive\.csv: the measured poses hardly move while the wheels"):
            calibrate(logged_problem(), [replace(log, poses=poses)], options(segment="log"))


@pytest.mark.parametrize("quantities", [("x", "y", "heading"), ("x", "y")], ids=len)
def test_a_coordinate_that_never_changes_is_refused(quantities):
    log = log_of(course(seconds=20.0), noise=NOISE, quantities=quantities)
    for place, noise in ((0, 0.0), (1, 1e-4)):
        poses = log.poses.copy()
        poses[:, place] = 0.8 + noise * np.random.default_rng(0).standard_normal(len(poses))
        words = rf"drive\.csv: {'xy'[place]}: hardly changes while the robot drives and turns"
        with pytest.raises(LogError, match=words):
            calibrate(logged_problem(), [replace(log, poses=poses)], options(segment="log"))


@pytest.mark.parametrize("quantities", [("x", "y", "heading"), ("x", "y")], ids=len)
@pytest.mark.parametrize("ratio", [1.0, 0.96])
def test_a_coordinate_may_stand_still_on_a_straight_line(ratio: float, quantities):
    own = truth_of(ROBOT, wheel_radius_right=0.05 / ratio, wheel_radius_left=0.05)
    speeds = np.outer(np.linspace(1.0, 6.0, 200), [ratio, 1.0])
    for heading in (0.0, np.pi / 2):
        log = log_of(course(ROBOT, own, inputs=speeds, start=(0.0, 0.0, heading)), quantities=quantities)
        assert min(np.ptp(log.poses[:, :2], axis=0)) < 1e-9
        assert frozen(Moves.of(ROBOT, [log])) is None


@pytest.mark.slow
def test_poses_too_small_for_their_squares_stand_still():
    log = log_of(course(seconds=10.0), noise=NOISE)
    for scale in (1e-300, 1e-160, 1e-20):
        small = replace(log, poses=log.poses * [1.0, 1.0, scale])
        with pytest.raises(LogError, match="hardly move"):
            calibrate(logged_problem(), [small], options(segment="log"))


@pytest.mark.slow
def test_a_single_log_is_reckoned_by_its_own_estimate():
    asked = options(segment="log", sensor_place=(), clock_offset=False)
    found = calibrate(logged_problem(), [log_of(course(seconds=10.0), noise=NOISE)], asked)
    (before,), (after,) = found.own.before, found.own.after
    assert after.rmse_position < 0.5 * before.rmse_position


@pytest.mark.slow
def test_a_coefficient_that_is_0_by_the_geometry_is_no_estimate_of_0_without_error():
    log = log_of(course(OMNI, np.array([0.041, 0.19]), seconds=10.0, period=0.2), noise=NOISE)
    asked = options(segment="log", noise="constant", clock_offset=False)
    names, values, errors = calibrate(logged_problem(model=OMNI), [log], asked).coefficients
    assert len(names) == 8
    assert "c22" not in names
    assert np.all(errors > 0)
    # As a parameter of its own it is as precise as the others, and its size is the largest of them.
    wanted = tuple(name for row in OMNI.coefficient_names for name in row)
    found = calibrate(logged_problem(model=OMNI, estimate=wanted), [log], asked)
    c22 = wanted.index("c22")
    assert found.fit.unknowns.scale[c22] == pytest.approx(2 * 0.04 / 3)
    assert abs(found.values[c22]) < 4 * found.standard_deviations["c22"]
    assert found.standard_deviations["c22"] == pytest.approx(found.standard_deviations["c21"], rel=1.0)
    for name, value in zip(names, values, strict=True):
        assert found.values[wanted.index(name)] == pytest.approx(value, rel=0.02)


@pytest.mark.parametrize("nominal", [0.0, np.sin(np.pi), -1e-18])
def test_a_nominal_value_that_is_the_rounding_of_0_is_no_size(nominal: float):
    assert Parameter("offset", nominal, "rad").scale == 0
    assert Parameter("offset", nominal, "rad", size=0.3).scale == 0.3
    assert Parameter("gain", 1e-9, "", size=0.3).scale == 1e-9
