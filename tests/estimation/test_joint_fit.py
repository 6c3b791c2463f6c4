"""The joint fit of logs without noise: it finds what the robot truly is."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from simulated import (
    ROBOT,
    TRUTH,
    XYH,
    arcs,
    by_name,
    course,
    fit_of,
    log_of,
    logged_problem,
    loosely,
    options,
    readings,
    search_of,
    several,
    truth_of,
    twists_of,
    unknowns_of,
)

from oed.estimation import calibrate
from oed.estimation.methods.gauss_newton import robust_loss
from oed.robots.models import (
    Ackermann,
    Mecanum,
    Model,
    OffsetDrive,
    OmniThree,
    PythonRobot,
    SkidSteerIcr,
    TractorTrailer,
    Tricycle,
)
from oed.robots.sensors.logged import Noise

PLACE = ("sensor_x", "sensor_y", "sensor_heading")
SITS = (0.11, -0.06, 0.15)
OFFSET = PythonRobot(
    object="oed.robots.models.differential_drive:OffsetDrive", wheel_radius=0.05, track=0.2
).made(Model)
ICR = SkidSteerIcr(wheel_radius=0.05, y_icr_left=0.2, y_icr_right=-0.2)

CASES: dict[str, tuple[Model, dict[str, float], tuple[str, ...]]] = {
    # The robot, its truth, what of the sensor's place its parameters do not make up for.
    "differential": (ROBOT, TRUTH, PLACE),
    "tricycle": (
        Tricycle(wheel_radius=0.1, wheelbase=0.4),
        {"wheel_radius": 0.103, "wheelbase": 0.385, "steering_offset": 0.04},
        PLACE,
    ),
    "ackermann": (
        Ackermann(wheel_radius=0.05, wheelbase=0.33),
        {"wheel_radius": 0.052, "wheelbase": 0.31, "steering_offset": -0.03, "steering_gain": 1.08},
        PLACE,
    ),
    "mecanum": (
        Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.3),
        {"wheel_radius": 0.0485, "half_wheelbase_plus_half_track": 0.33},
        PLACE,
    ),
    "omni": (
        OmniThree(wheel_radius=0.04, centre_distance=0.2),
        {"wheel_radius": 0.0412, "centre_distance": 0.19},
        PLACE,
    ),
    "icr": (
        ICR,
        {
            "y_icr_left": 0.26,
            "y_icr_right": -0.23,
            "x_icr": -0.04,
            "alpha_right": 0.93,
            "alpha_left": 0.96,
        },
        ("sensor_heading",),
    ),
    "offset": (
        OffsetDrive(wheel_radius=0.05, track=0.2),
        {**TRUTH, "sensor_offset": 0.03},
        ("sensor_x", "sensor_heading"),
    ),
    "trailer": (
        TractorTrailer(wheel_radius=0.05, track=0.2, hitch_offset=0.1, trailer_length=0.4),
        {**TRUTH, "hitch_offset": 0.12, "trailer_length": 0.43},
        PLACE,
    ),
    "python": (OFFSET, {**TRUTH, "sensor_offset": -0.02}, ("sensor_x", "sensor_heading")),
}
QUICK = ("differential", "tricycle", "trailer")
every_case = pytest.mark.parametrize(
    "case", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CASES]
)


class TestRecovery:
    @pytest.mark.slow
    @every_case
    def test_of_parameters_place_and_clock(self, case: str):
        model, truth, told = CASES[case]
        sits = tuple(one if name in told else 0.0 for name, one in zip(PLACE, SITS, strict=True))
        quantities = (*XYH, "trailer_angle") if case == "trailer" else XYH
        drive = course(model, truth_of(model, **truth), seconds=12.0, period=0.12)
        log = log_of(drive, place=sits, offset=0.02, quantities=quantities)
        fit = fit_of([log], unknowns_of(model, told, clocks=1))
        assert fit.converged
        wanted = np.array([*truth_of(model, **truth), *(one for one in sits if one), 0.02])
        assert fit.values == pytest.approx(wanted, rel=1e-6, abs=1e-8)
        # At the first pose the wheels are not logged yet.
        assert fit.starts[0] == pytest.approx(drive.states[1], abs=1e-6)

    def test_of_several_logs_with_clocks_of_their_own(self):
        offsets = (0.03, -0.04, 0.01)
        logs = [
            log_of(course(seed=seed, seconds=8.0), offset=offset, place=SITS, name=str(seed))
            for seed, offset in enumerate(offsets)
        ]
        fit = fit_of(logs, unknowns_of(ROBOT, PLACE, clocks=3))
        assert fit.values == pytest.approx(np.array([*TRUTH.values(), *SITS, *offsets]), rel=1e-6, abs=1e-7)
        assert fit.unknowns.names[-1] == "clock_offset_3"

    def test_of_logs_of_one_file_with_one_clock(self):
        logs = [
            log_of(course(seed=seed, seconds=8.0), offset=0.03, name=str(seed), file="a.csv")
            for seed in (0, 1)
        ]
        fit = fit_of(logs, unknowns_of(clocks=1))
        assert fit.values == pytest.approx(np.array([*TRUTH.values(), 0.03]), rel=1e-6)

    @pytest.mark.parametrize("turned", [0.0, 2.5])
    def test_from_positions_alone(self, turned: float):
        drive = course(seconds=12.0, start=(1.0, 2.0, turned))
        log = log_of(drive, place=(0.11, -0.06, 0.0), quantities=("x", "y"))
        fit = fit_of([log], unknowns_of(ROBOT, PLACE[:2]))
        assert fit.values == pytest.approx(np.array([*TRUTH.values(), 0.11, -0.06]), rel=1e-6)

    def test_of_what_headings_alone_tell(self):
        log = log_of(course(seconds=12.0), quantities=("heading",))
        fit = fit_of([log], unknowns_of(names=("wheel_radius_right", "wheel_radius_left")))
        own = np.array([TRUTH["wheel_radius_right"], TRUTH["wheel_radius_left"]]) / TRUTH["track"]
        assert fit.values / 0.2 == pytest.approx(own, rel=1e-6)

    @pytest.mark.slow
    def test_whatever_the_segments_length(self):
        logs = several(2, place=SITS)
        for seconds in (0.25, 1.0, 3.7, np.inf):
            fit = fit_of(logs, unknowns_of(ROBOT, PLACE), seconds=seconds)
            assert fit.values == pytest.approx(np.array([*TRUTH.values(), *SITS]), rel=1e-6), seconds

    @pytest.mark.parametrize(("gap", "count"), [(None, 1), (3.0, 2)])
    def test_across_gaps_in_the_poses(self, gap: float | None, count: int):
        log = log_of(course(seconds=16.0))
        kept = (log.pose_times < 5) | (log.pose_times > 9)
        fit = fit_of([replace(log, pose_times=log.pose_times[kept], poses=log.poses[kept], gap=gap)])
        assert fit.layout.count == count
        assert fit.values == pytest.approx(np.array([*TRUTH.values()]), rel=1e-6)

    def test_of_one_parameter_the_others_nominal(self):
        log = log_of(course(ROBOT, truth_of(ROBOT, track=0.22)))
        fit = fit_of([log], unknowns_of(names=("track",)))
        assert fit.values == pytest.approx([0.22], rel=1e-6)

    def test_with_the_place_that_a_study_gives(self):
        fit = fit_of([log_of(course(), place=SITS)], unknowns_of(sits=SITS))
        assert fit.values == pytest.approx([*TRUTH.values()], rel=1e-6)

    def test_by_the_midpoint_rule_is_not_that_of_arcs(self):
        log = log_of(course())
        fit = fit_of([log], unknowns_of(ROBOT.system("midpoint")))
        assert 1e-6 < np.abs(fit.values / [*TRUTH.values()] - 1).max() < 0.02


class TestSolution:
    """Of noisy logs, against SciPy on plain NumPy."""

    DRIVE = course(seconds=6.0, period=0.15)
    LOG = log_of(DRIVE, noise=(0.004, 0.01), place=SITS)

    def plain(self, loss: str):
        def residuals(vector: np.ndarray) -> np.ndarray:
            parameters, start, place = vector[:3], vector[3:6], vector[6:]
            states = arcs(start, twists_of(ROBOT, self.DRIVE.inputs, parameters), np.diff(self.DRIVE.times))
            return ((self.LOG.poses - readings(states, place)) / [0.004, 0.004, 0.01]).ravel()

        begin = np.array([*TRUTH.values(), *self.DRIVE.states[0], *SITS])
        return least_squares(
            residuals, begin, loss=loss, x_scale=np.abs(begin), xtol=1e-14, ftol=1e-14, gtol=1e-10
        )

    @pytest.mark.parametrize("loss", ["linear", "huber", "cauchy"])
    def test_is_scipys(self, loss: str):
        wanted = self.plain(loss)
        specified = {"position": Noise(0.004), "heading": Noise(0.01)}
        fit = fit_of([self.LOG], unknowns_of(ROBOT, PLACE), loss=loss, specified=specified)
        assert fit.values == pytest.approx(np.delete(wanted.x, [3, 4, 5]), rel=2e-5)
        assert fit.starts[0] == pytest.approx(wanted.x[3:6], abs=1e-5)
        if loss == "linear":
            whole = np.linalg.inv(wanted.jac.T @ wanted.jac)
            own = np.delete(np.delete(whole, [3, 4, 5], 0), [3, 4, 5], 1)
            assert fit.inverse == pytest.approx(own, rel=1e-3, abs=1e-4 * np.abs(own).max())
            hat = wanted.jac @ whole @ wanted.jac.T
            assert fit.redundancy.ravel() == pytest.approx(1 - np.diag(hat), abs=1e-4)

    @pytest.mark.parametrize("loss", ["huber", "cauchy", "soft_l1"])
    def test_bend_is_how_much_flatter_the_loss_is_than_its_weights_say(self, loss: str):
        fit = fit_of([self.LOG], unknowns_of(ROBOT, PLACE), loss=loss)
        white, step = fit.white[fit.layout.valid], 1e-6
        weights = robust_loss(loss, white**2)[1]
        ahead, back = (one * robust_loss(loss, one**2)[1] for one in (white + step, white - step))
        assert fit.bend == pytest.approx(((ahead - back) / (2 * step)).sum() / weights.sum(), rel=1e-4)
        assert fit.bend < 0.98

    def test_freedom_is_readings_less_unknowns(self):
        fit = fit_of(several(3, noise=(0.004, 0.01)), seconds=4.0)
        assert fit.redundancy.sum() == pytest.approx(
            fit.layout.valid.sum() - 3 * fit.layout.count - 3, abs=1e-6
        )

    def test_scores_add_up_to_nothing(self):
        fit = fit_of(several(3, noise=(0.004, 0.01)), seconds=4.0)
        steps = fit.inverse @ fit.scores.sum(axis=0) / np.sqrt(np.diag(fit.inverse))
        assert np.abs(steps).max() < 0.01

    @pytest.mark.slow
    def test_what_was_known_pulls(self):
        logs = several(2, noise=(0.004, 0.01))
        free, unknowns = fit_of(logs), unknowns_of()
        told = fit_of(logs, known=loosely(unknowns, 1e-8))
        assert told.values == pytest.approx(unknowns.nominal, rel=1e-6)
        apart = loosely(unknowns, 1e-3)
        fit = fit_of(logs, known=apart)
        pull = apart.information @ (apart.centre - fit.values)
        sizes = np.sqrt(np.diag(fit.total))
        assert (fit.scores.sum(axis=0) + pull) / sizes == pytest.approx(np.zeros(3), abs=0.02)
        assert np.abs(free.values - fit.values).max() > 1e-5


def test_a_search_leaves_nothing_behind():
    # Readings of a long log and their derivatives are large: they go with the search, not when Python next
    # looks for circles.
    search = search_of(several(2), seconds=4.0)
    gone = weakref.ref(search)
    gc.disable()
    try:
        fit = search.fit()
        del search
        assert gone() is None
    finally:
        gc.enable()
    assert fit.converged


class TestStarts:
    @pytest.mark.slow
    def test_a_sensor_turned_by_a_right_angle_is_found(self):
        log = log_of(course(seconds=8.0), place=(0.1, 0.0, np.pi / 2), noise=(0.001, 0.002))
        found = calibrate(logged_problem(), [log], options(segment="log", clock_offset=False))
        assert by_name(found.fit)["sensor_heading"] == pytest.approx(np.pi / 2, abs=0.01)
        assert np.all(found.values > 0)
