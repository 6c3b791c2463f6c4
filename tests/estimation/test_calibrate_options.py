"""`calibrate` as a whole: options of every kind, odd logs, and what it says of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulated import ROBOT, TRUTH, by_name, course, log_of, logged_problem, options, several, truth_of

from oed.estimation import Calibration, calibrate
from oed.estimation.assessment.covariance import Covariance
from oed.estimation.assessment.trusted_covariance import covariances_of
from oed.estimation.setup.noise import specified_noise
from oed.estimation.setup.unknowns import specified_mount
from oed.foundation.errors import LogError, ProblemError
from oed.kernel.measurement.prior import Prior
from oed.robots.models import TractorTrailer
from oed.robots.sensors import Displacements, Poses, Several, TrailerAngle
from oed.robots.sensors.logged import Noise
from oed.robots.sensors.mounting import LeverArm
from oed.robots.sensors.poses import AbsoluteNoise

NOISE = (0.002, 0.005)
STATED = AbsoluteNoise(position=0.002, heading=0.005)
SITS = (0.1, -0.05, 0.2)
LOG = log_of(course(seconds=4.0), noise=NOISE, place=SITS)
MANY = several(5, seconds=6.0, noise=NOISE, place=SITS, file="all.csv")
TRUE = np.array([*TRUTH.values()])


def found_by(logs=(LOG,), problem=None, **keys) -> Calibration:
    usual = {"segment": "log", "noise": "constant", "clock_offset": False}
    return calibrate(problem or logged_problem(), logs, options(**{**usual, **keys}))


@cache
def plainly_found() -> Calibration:
    return found_by()


@cache
def found_in_parts() -> Calibration:
    return found_by(MANY, covariance="sandwich", segment=1.0, replicates=200)


def covariances(found: Calibration, **keys) -> tuple[Covariance, ...]:
    """Of the same fit, by other options."""
    return covariances_of(found.fit, options(**keys), found.drift, drifts=False, seed=0)


def within(found: Calibration, true=TRUE, times: float = 5.0) -> bool:
    errors = np.sqrt(np.diag(found.covariance))
    return bool(np.all(np.abs(found.values - true) < times * errors))


class TestOptions:
    @pytest.mark.slow
    def test_defaults(self):
        found = calibrate(logged_problem(), [LOG])
        assert within(found)
        # Four seconds are too short to show whether the robot drifts.
        assert [one.name for one in found.covariances] == ["drift", "information"]
        assert found.drifts is None
        assert found.segmenting is not None
        assert found.segmenting.seconds == np.inf
        assert found.fit.converged
        assert found.fit.unknowns.clocks == 1
        (note,) = found.notes
        assert note.startswith("drift, which the logs are too short to show or rule out, taken as large as ")
        assert by_name(found.fit)["sensor_x"] == pytest.approx(0.1, abs=0.002)

    @pytest.mark.slow
    @pytest.mark.parametrize("way", ["information", "drift", "sandwich", "bootstrap"])
    def test_covariance(self, way):
        found = found_in_parts()
        chosen, *others = covariances(found, covariance=way, replicates=200)
        assert chosen.name == way
        assert {way, *(one.name for one in others)} == {"information", "drift", "sandwich", "bootstrap"}
        assert np.all(np.abs(found.values - TRUE) < 5 * chosen.deviations[:3])

    @pytest.mark.slow
    def test_covariance_that_is_asked_for_comes_first(self):
        found = found_in_parts()
        assert found.covariances[0].name == "sandwich"
        assert {one.name for one in found.covariances} == {"information", "drift", "sandwich", "bootstrap"}
        assert within(found)
        assert found.standard_deviations == pytest.approx(
            dict(zip(found.parameters, found.covariances[0].deviations[:3], strict=True))
        )

    @pytest.mark.parametrize("way", ["sandwich", "bootstrap"])
    @pytest.mark.slow
    def test_covariance_of_too_few_parts_is_refused(self, way):
        with pytest.raises(ProblemError, match=rf"calibration\.covariance: .*too short for {way}: 1 blocks"):
            covariances(plainly_found(), covariance=way)

    @pytest.mark.slow
    def test_noise_as_stated(self):
        found = found_by(noise="specified")
        assert dict(found.fit.noises) == specified_noise(logged_problem().measurement)
        assert within(found)

    def test_noise_that_is_not_stated(self):
        heading = Poses(quantities=("heading",), noise=AbsoluteNoise(heading=0.01))
        problem = logged_problem(measurement=heading, estimate=("wheel_radius_right", "wheel_radius_left"))
        with pytest.raises(ProblemError, match=r"calibration\.noise: .*no noise of x, y; use noise"):
            found_by(problem=problem, noise="specified")

    @pytest.mark.slow
    def test_every_sensor_states_the_noise_of_what_it_reads(self):
        model = TractorTrailer(wheel_radius=0.05, track=0.2, hitch_offset=0.1, trailer_length=0.4)
        both = Several(sensors=(Poses(noise=STATED), TrailerAngle(noise=0.004)))
        quantities = ("x", "y", "heading", "trailer_angle")
        log = log_of(course(model, np.array(model.nominal), seconds=4.0), noise=NOISE, quantities=quantities)
        found = found_by([log], logged_problem(model=model, measurement=both), noise="specified")
        assert found.fit.noises["trailer_angle"] == Noise(0.004)
        judged = {one.about for one in found.diagnostics if one.name == "stated_noise"}
        assert judged == {"position", "heading", "trailer_angle"}

    @pytest.mark.slow
    def test_block(self):
        few = {"covariance": "bootstrap", "replicates": 100}
        short, long = (covariances(found_in_parts(), **few, block=size) for size in (1.0, 3.0))
        assert short[0].degrees == 29
        assert long[0].degrees == 9

    @pytest.mark.slow
    @pytest.mark.parametrize("seconds", [1e-3, 1.7, 1e3])
    def test_segment(self, seconds: float):
        found = found_by(segment=seconds)
        assert found.segmenting is None
        assert found.fit.layout.seconds == seconds
        assert within(found)

    @pytest.mark.slow
    def test_sensor_place(self):
        log = log_of(course(seconds=4.0), noise=NOISE)
        found = found_by([log], sensor_place=[], clock_offset=True)
        assert found.fit.unknowns.names == (*TRUTH, "clock_offset")
        assert within(found)
        assert found_by([log], sensor_place=["sensor_y"]).fit.unknowns.place == ("sensor_y",)

    @pytest.mark.slow
    def test_clock_offset(self):
        found = plainly_found()
        assert found.fit.unknowns.clocks == 0
        assert found.fit.clock_offsets == pytest.approx([0.0])

    @pytest.mark.slow
    def test_loss(self):
        assert within(found_by(loss="cauchy"))

    @pytest.mark.slow
    def test_estimate_of_one_parameter(self):
        log = log_of(course(ROBOT, truth_of(ROBOT, track=0.22), seconds=6.0), noise=NOISE)
        found = found_by([log], logged_problem(estimate=("track",)))
        assert found.parameters == ("track",)
        assert within(found, np.array([0.22]))

    @pytest.mark.slow
    def test_coefficients_hide_the_sensors_side(self):
        found = found_by(problem=logged_problem(estimate=("c11", "c12", "c21", "c22")))
        hidden, *_ = found.notes
        assert hidden == "sensor_y cannot be separated from the parameters: taken as the study has it"
        assert found.fit.unknowns.place == ("sensor_x", "sensor_heading")
        right, left, track = TRUE
        yaw = np.array([right, -left]) / track
        # Held at 0, where it is at -0.05 m: the sensor's own forward speed.
        wanted = np.array([*yaw, *(np.array([right, left]) / 2 + 0.05 * yaw)])
        assert within(found, wanted)
        assert found.coefficients[0] == ()

    @pytest.mark.slow
    def test_coefficients_of_the_parameters(self):
        names, values, errors = plainly_found().coefficients
        assert names == ("c11", "c12", "c21", "c22")
        right, left, track = TRUE
        wanted = np.array([right / track, -left / track, right / 2, left / 2])
        assert np.all(np.abs(values - wanted) < 5 * errors)

    @pytest.mark.slow
    def test_the_effective_track_is_the_track(self):
        found = plainly_found()
        track, error = found.effective_track
        assert track == pytest.approx(found.values[2])
        assert error == pytest.approx(found.standard_deviations["track"])

    @pytest.mark.slow
    def test_a_lever_arm_that_the_study_gives(self):
        measurement = Poses(noise=STATED, lever_arm=LeverArm(x=0.1, y=-0.05))
        assert specified_mount(measurement).sits == (0.1, -0.05, 0.0)
        found = found_by(problem=logged_problem(measurement=measurement))
        assert found.fit.unknowns.place == ("sensor_heading",)
        assert within(found)

    @pytest.mark.slow
    def test_a_prior(self):
        problem = logged_problem(prior=Prior(standard_deviations={"track": "1 um"}))
        found = found_by(problem=problem)
        assert by_name(found.fit)["track"] == pytest.approx(0.2, abs=1e-4)
        assert found.standard_deviations["track"] == pytest.approx(1e-6, rel=0.01)

    def test_displacements_state_no_place(self):
        assert specified_mount(Displacements(segments=4)).sits == (0.0, 0.0, 0.0)
        assert specified_noise(Displacements(segments=4)) == {}


class TestOddLogs:
    @pytest.mark.parametrize("noise", [NOISE, (0.0, 0.0)])
    @pytest.mark.slow
    def test_a_robot_at_rest(self, noise):
        log = log_of(course(inputs=np.zeros((60, 2)), seconds=6), noise=noise)
        found = calibrate(logged_problem(), [log])
        assert found.values == pytest.approx(ROBOT.nominal, rel=1e-6)
        assert all(name in " ".join(found.weak_directions) for name in TRUTH)
        assert np.sqrt(np.diag(found.covariance)) == pytest.approx(ROBOT.nominal, rel=0.05)

    @pytest.mark.slow
    def test_headings_that_never_change(self):
        log = log_of(course(ROBOT, truth_of(ROBOT), start=(0, 0, 0), inputs=np.full((60, 2), 3.0), seconds=6))
        found = found_by([log])
        assert np.isfinite(found.values).all()
        assert any("track" in text for text in found.weak_directions)

    @pytest.mark.slow
    def test_two_poses(self):
        for rows in ([0, 50], [40, 41]):
            log = log_of(course(seconds=6.0), noise=NOISE, rows=np.array(rows))
            with pytest.raises(LogError, match="log more poses"):
                calibrate(logged_problem(), [log])

    @pytest.mark.slow
    def test_a_log_that_hardly_overlaps_its_poses(self):
        late = replace(LOG, pose_times=LOG.pose_times + 3.5)
        assert np.isfinite(calibrate(logged_problem(), [late]).values).all()

    def test_clocks_that_never_meet(self):
        late = replace(LOG, pose_times=LOG.pose_times + 100)
        with pytest.raises(LogError, match=r"drive\.csv: no poses while the wheels are logged"):
            calibrate(logged_problem(), [late])

    def test_logs_of_different_quantities(self):
        other = log_of(course(seed=1), quantities=("x", "y"), name="other")
        with pytest.raises(LogError, match=r"other\.csv: holds x, y, drive x, y, heading"):
            calibrate(logged_problem(), [LOG, other])

    @pytest.mark.slow
    def test_positions_alone(self):
        log = log_of(course(seconds=6.0), noise=NOISE, quantities=("x", "y"), place=(0.1, -0.05, 0.0))
        found = found_by([log])
        assert found.fit.unknowns.place == ("sensor_x", "sensor_y")
        assert within(found)

    @pytest.mark.slow
    def test_headings_alone(self):
        log = log_of(course(seconds=6.0), noise=NOISE, quantities=("heading",))
        found = found_by([log])
        assert found.fit.unknowns.place == ()
        assert "track separately" in " ".join(found.weak_directions)
        assert found.cross_validation == ()

    @pytest.mark.slow
    def test_dead_reckoning_apart_needs_positions(self):
        heading = log_of(course(seed=1), quantities=("heading",), name="apart")
        with pytest.raises(LogError, match=r"apart\.csv: dead reckoning needs positions"):
            calibrate(logged_problem(), [LOG], options(segment="log"), test_logs=[heading])
