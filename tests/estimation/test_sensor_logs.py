"""Parameters from logs with more sensors than poses: against the truth of simulated drives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from builders import problem_of
from pulls import SETS, require_pulls
from sensed import PLACES, gyro, sighted, with_sensors
from simulated import ROBOT, TRUTH, Course, course

from oed.estimation import Calibration, CalibrationOptions, calibrate
from oed.estimation.prediction.grids import grid_of
from oed.estimation.prediction.layout import cut
from oed.foundation.errors import LogError, ProblemError
from oed.kernel.measurement.sensor import Sensor
from oed.kernel.problem import Problem
from oed.logs.log import Log, SensorReadings
from oed.robots.sensors import Landmarks, Poses, Ranges, Several, Tags, YawRate

POSITIONS = Poses(quantities=("x", "y"), noise={"position": 0.01})
GYRO = YawRate(noise=0.01, scale=0.05)
RANGES = Ranges(beacons=PLACES[:3], noise=0.02)
SIGHT = {"range": 0.02, "bearing": 0.01, "orientation": 0.02}
ROUGH = tuple((x + 0.1, y - 0.15) for x, y in PLACES)
TAGS = tuple((*place, angle) for place, angle in zip(PLACES, (0.3, 2.0, -1.0, 2.8), strict=True))
CAMERA = (0.2, -0.05, 0.3)


@dataclass(frozen=True)
class Twin:
    """A robot with sensors, and the logs that it would have made.

    Attributes:
        sensors: of the study.
        log: of a drive and a seed.
        truth: of nuisances.
    """

    sensors: tuple[Sensor, ...]
    log: Callable[[Course, int], Log]
    truth: dict[str, float]


def every(drive: Course, seconds: float) -> np.ndarray:
    return np.arange(0, len(drive.times), knots(drive, seconds))


def knots(drive: Course, seconds: float) -> int:
    return max(1, round(seconds / (drive.times[1] - drive.times[0])))


TWINS = {
    "positions and a gyro": Twin(
        (POSITIONS, GYRO),
        lambda drive, seed: with_sensors(
            drive,
            gyro(drive, noise=0.01, bias=0.02, scale=1.03, seed=seed),
            every=knots(drive, 0.4),
            noise=(0.01, 0.0),
            quantities=("x", "y"),
            seed=seed,
        ),
        {"yaw_rate.bias": 0.02, "yaw_rate.scale": 1.03},
    ),
    "beacons and a gyro, no poses": Twin(
        (RANGES.model_copy(update={"bias": "unknown"}), YawRate(noise=0.01)),
        lambda drive, seed: with_sensors(
            drive,
            gyro(drive, noise=0.01, bias=0.02, seed=seed),
            sighted(
                drive,
                "ranges",
                "r",
                PLACES[:3],
                noise=[0.02],
                rows=every(drive, 0.2),
                missing=0.2,
                bias=0.1,
                seed=seed,
            ),
            poses=False,
        ),
        {"ranges.bias": 0.1, "yaw_rate.bias": 0.02},
    ),
    "landmarks, late": Twin(
        (Landmarks(landmarks=PLACES, noise=SIGHT, latency="unknown"),),
        lambda drive, seed: with_sensors(
            drive,
            sighted(
                drive,
                "landmarks",
                "rb",
                PLACES,
                noise=[0.02, 0.01],
                rows=every(drive, 0.2),
                missing=0.5,
                late=0.08,
                seed=seed,
            ),
            poses=False,
        ),
        {"clock_offset": -0.08},
    ),
    "landmarks of unknown place": Twin(
        (Landmarks(landmarks=ROUGH, noise=SIGHT, map="unknown"),),
        lambda drive, seed: with_sensors(
            drive,
            sighted(
                drive,
                "landmarks",
                "rb",
                PLACES,
                noise=[0.02, 0.01],
                rows=every(drive, 0.2),
                missing=0.4,
                seed=seed,
            ),
            poses=False,
        ),
        {},
    ),
    "tags from a camera somewhere": Twin(
        (
            Tags(
                tags=TAGS,
                noise=SIGHT,
                lever_arm={"x": 0.15, "known": False, "deviation": 0.1, "heading": 0.25},
            ),
        ),
        lambda drive, seed: with_sensors(
            drive,
            sighted(
                drive,
                "tags",
                "rbo",
                TAGS,
                noise=[0.02, 0.01, 0.02],
                rows=every(drive, 0.3),
                camera=CAMERA,
                missing=0.6,
                seed=seed,
            ),
            poses=False,
        ),
        {f"tags.lever_arm.{name}": value for name, value in zip(("x", "y", "heading"), CAMERA, strict=True)},
    ),
    "satellite positions, late, off to the side": Twin(
        (POSITIONS.model_copy(update={"latency": "unknown"}), YawRate(noise=0.01)),
        lambda drive, seed: with_sensors(
            drive,
            gyro(drive, noise=0.01, bias=0.02, seed=seed),
            every=knots(drive, 0.4),
            noise=(0.01, 0.0),
            quantities=("x", "y"),
            place=(0.15, 0.05, 0.0),
            offset=-0.12,
            seed=seed,
        ),
        {"sensor_x": 0.15, "sensor_y": 0.05, "clock_offset": -0.12},
    ),
}


@cache
def problem_with(sensors: tuple[Sensor, ...]) -> Problem:
    return problem_of(model=ROBOT, measurement=Several(sensors=sensors))


def calibrated(twin: Twin, *logs: Log, **options) -> Calibration:
    problem = problem_with(twin.sensors)
    chosen = CalibrationOptions(**{"segment": "log", "covariance": "information"} | options)
    return calibrate(problem, logs, chosen)


def errors(found: Calibration, twin: Twin) -> dict[str, float]:
    """Estimates less the truth, in standard errors, of all whose truth is known."""
    truth, fit = TRUTH | twin.truth, found.fit
    sizes = found.covariances[0].deviations
    values = [*fit.values[: len(fit.values) - fit.unknowns.clocks], *fit.clock_offsets]
    names = fit.unknowns.names
    return {
        name: (value - truth[name]) / size
        for name, value, size in zip(names, values, sizes, strict=False)
        if name in truth
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [one if place < 1 else pytest.param(one, marks=pytest.mark.slow) for place, one in enumerate(TWINS)],
)
def test_estimates_are_the_truth_within_their_errors(name: str):
    twin = TWINS[name]
    seconds, period = (14.0, 0.04) if "late" in name or "tags" in name else (10.0, 0.05)
    found = calibrated(twin, twin.log(course(seconds=seconds, period=period, seed=3), 3))
    off = errors(found, twin)
    assert set(off) == {*TRUTH, *twin.truth}
    assert max(map(abs, off.values())) < 3.5
    assert found.fit.converged
    assert 0.7 < found.fit.misfit < 1.3
    # And they are worth something.
    assert max(found.standard_deviations[one] / value for one, value in TRUTH.items()) < 0.03
    assert found.notes == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["positions and a gyro", "landmarks of unknown place"])
def test_intervals_cover_the_truth(name: str):
    twin, off, covariances, count = TWINS[name], [], [], len(TRUTH)
    for seed in range(SETS):
        drive = course(seconds=8.0, period=0.2, seed=seed)
        found = calibrated(twin, twin.log(drive, seed), noise="specified", clock_offset=False)
        assert found.fit.unknowns.names[:count] == tuple(TRUTH)
        off.append(found.fit.values[:count] - list(TRUTH.values()))
        covariances.append(found.covariances[0].matrix[:count, :count])
    require_pulls(np.array(off), covariances)


def test_means_of_a_gyro_over_periods_are_exact_angles():
    drive = course(seconds=6.0, period=0.02)
    rows = np.sort(np.random.default_rng(0).choice(300, 40, replace=False))
    log = with_sensors(drive, gyro(drive), rows=rows)
    grid = grid_of(log, (("yaw_rate", YawRate(noise=0.01)),), 0.0)
    inside = grid.valid[:-1, -1]
    turned = np.interp(grid.times, drive.times, drive.states[:, 2])
    np.testing.assert_allclose(
        (grid.readings[:-1, -1] * np.diff(grid.times))[inside], np.diff(turned)[inside], atol=1e-3
    )
    counts = np.diff(grid.times) / 0.02
    assert np.abs(grid.averaged[:-1, -1] - counts)[inside].max() <= 1.0
    assert np.mean(inside) > 0.9
    assert set(log.pose_times) <= set(grid.times)


def test_a_gyro_that_pauses_says_nothing_of_its_pause():
    drive = course(seconds=6.0, period=0.02)
    whole = gyro(drive)
    heard = (whole.times < 2.03) | (whole.times > 3.05)
    paused = replace(whole, times=whole.times[heard], values=whole.values[heard])
    log = with_sensors(drive, paused, rows=np.arange(0, 301, 10))
    grid = grid_of(log, (("yaw_rate", YawRate(noise=0.01)),), 0.0)
    silent = (grid.times > 1.95) & (grid.times < 3.05)
    assert not grid.valid[silent, -1].any()
    assert grid.valid[~silent, -1].sum() > 40


def test_a_slow_gyro_counts_once():
    drive = course(seconds=6.0, period=0.02)
    log = with_sensors(drive, gyro(drive, every=25), rows=np.arange(0, 300, 2))
    grid = grid_of(log, (("yaw_rate", YawRate(noise=0.01)),), 0.0)
    assert grid.valid[:, -1].sum() == 12
    assert set(grid.averaged[grid.valid[:, -1], -1]) == {1.0}


def test_wheels_carry_a_drive_through_a_time_in_which_nothing_is_seen():
    drive = course(seconds=12.0, period=0.1)
    rows = np.concatenate([np.arange(0, 40, 2), np.arange(70, 120, 2)])
    seen = sighted(drive, "landmarks", "rb", PLACES, noise=[0.02, 0.01], rows=rows)
    log = with_sensors(drive, seen, poses=False)
    sensors = (("landmarks", Landmarks(landmarks=PLACES, noise=SIGHT)),)
    assert cut([log], np.inf, [0.0], sensors).count == 1
    assert cut([replace(log, gap=1.0)], np.inf, [0.0], sensors).count == 2


@pytest.mark.slow
def test_a_sensor_that_logs_lack_is_named():
    drive = course(seconds=6.0, period=0.1)
    twin = Twin((POSITIONS, GYRO), lambda *_: None, {})
    (note,) = calibrated(twin, with_sensors(drive, noise=(1e-3, 0.0), quantities=("x", "y"))).notes
    assert note.startswith("yaw_rate is not used: the logs have no readings of it")


@pytest.mark.parametrize("method", ["gls", "two_stage"])
def test_windows_take_poses_alone(method: str):
    drive = course(seconds=6.0, period=0.1)
    twin = Twin((Poses(noise={"position": 0.01, "heading": 0.01}), GYRO), lambda *_: None, {})
    with pytest.raises(ProblemError, match=f"{method} takes poses alone; the logs have yaw_rate"):
        calibrated(twin, with_sensors(drive, gyro(drive)), method=method)


def test_nothing_but_a_gyro_is_too_little():
    drive = course(seconds=6.0, period=0.1)
    twin = Twin((GYRO,), lambda *_: None, {})
    log = replace(with_sensors(drive, gyro(drive)), pose_times=np.zeros(0), poses=np.zeros((0, 0)))
    with pytest.raises(LogError, match="neither poses nor anything else"):
        calibrated(twin, replace(log, quantities=()))


def test_readings_go_from_clock_to_clock():
    read = SensorReadings("yaw_rate", np.arange(3.0), np.ones((3, 1)), "inputs")
    np.testing.assert_allclose(read.on("poses", 0.5), [-0.5, 0.5, 1.5])
    np.testing.assert_allclose(read.on("inputs", 0.5), read.times)
    np.testing.assert_allclose(replace(read, clock="poses").on("inputs", 0.5), [0.5, 1.5, 2.5])
    np.testing.assert_allclose(read.integrals_at(np.array([0.5, 2.0])), [[0.5], [2.0]])


@pytest.mark.slow
def test_a_landmark_elsewhere_than_the_study_has_it_is_named():
    drive = course(seconds=8.0, period=0.1, seed=3)
    wrong = [*PLACES[:3], (PLACES[3][0] + 0.6, PLACES[3][1])]
    twin = Twin((Landmarks(landmarks=wrong, ids=(7, 8, 9, 12), noise=SIGHT),), lambda *_: None, {})
    rows = np.arange(0, 80, 2)
    log = with_sensors(
        drive, sighted(drive, "landmarks", "rb", PLACES, noise=[0.02, 0.01], rows=rows), poses=False
    )
    found = calibrated(twin, log, noise="specified", loss="huber")
    doubts = [one.message for one in found.doubts if one.name == "odd_point"]
    assert any(one.startswith("landmarks.range[12] is") and "place in the study" in one for one in doubts)
    assert not any("[8]" in one for one in doubts)


@pytest.mark.slow
def test_a_map_that_nobody_knows_is_in_the_frame_of_its_first_landmarks():
    twin = TWINS["landmarks of unknown place"]
    found = calibrated(twin, twin.log(course(seconds=8.0, period=0.1, seed=3), 3), noise="specified")
    unknowns = found.fit.unknowns
    values = dict(zip(unknowns.names, found.fit.values, strict=True))
    sizes = dict(zip(unknowns.names, found.covariances[0].deviations, strict=True))
    map_ = np.array([[values[f"landmarks.landmark_{one}.{axis}"] for axis in "xy"] for one in range(1, 5)])
    np.testing.assert_allclose(map_[0], ROUGH[0], atol=1e-2)
    apart = np.linalg.norm(map_[:, None] - map_[None], axis=-1)
    true = np.linalg.norm(np.array(PLACES)[:, None] - np.array(PLACES)[None], axis=-1)
    np.testing.assert_allclose(apart, true, atol=0.05)
    assert max(size for name, size in sizes.items() if "landmark_" in name) < 0.05
