"""Drives whose numbers are no numbers: what is said of them, and that searches pass them over."""

from __future__ import annotations

import pickle
from functools import partial

import casadi as ca
import numpy as np
import pytest
from builders import ACCELERATION, BOX, SPEED, problem_of, random_drive

import oed
from oed.foundation.errors import NotFinite
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.identifiability import ambiguities, require_identifiable
from oed.kernel.limit import PathLimit, Rows
from oed.kernel.measurement.sensor import Moment
from oed.kernel.solution import Status
from oed.robots.baselines import baselines
from oed.robots.limits import WheelJerk
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import Poses, Several, YawRate
from oed.robots.sensors.placed import PlacedSensor
from oed.robots.space import DesignSpace

POSES = Poses(noise={"position": 0.01, "heading": 0.01})
SPACE = DesignSpace(duration=10, samples=20, spline=Spline(coefficients=8))


class PlainRanges(PlacedSensor):
    """Distances from a beacon at the origin, which have no derivative there."""

    kind: str = "plain_ranges"

    def reading(self, moment: Moment):
        x, y = self.position(moment)
        return ca.sqrt(x**2 + y**2)

    def whitening(self, moment: Moment):
        return ca.SX.eye(1) / 0.01


class Overflowing(DifferentialDrive):
    """A robot whose lateral speed is beyond all numbers above a wheel speed of 8 rad/s."""

    kind: str = "overflowing"

    def twist(self, inputs, parameters):
        forward, _, yaw_rate = ca.vertsplit(super().twist(inputs, parameters))
        return ca.vertcat(forward, ca.if_else(inputs[0] > 8, ca.inf, 0), yaw_rate)


class Nowhere(PathLimit):
    """A limit that is no number anywhere but at the origin."""

    name = "nowhere"
    per_metre = 1.0

    def rows_at(self, path, model):
        values = ca.sqrt(-(path[:, 0] ** 2))
        return Rows(values, np.zeros(values.shape[0]), np.full(values.shape[0], np.inf), 1.0, "m")


posed_problem = partial(problem_of, measurement=POSES, design=SPACE, criterion=oed.E())


def overflowing() -> Overflowing:
    return Overflowing(wheel_radius=0.049, track=0.18)


class TestWhatIsSaid:
    @pytest.mark.parametrize("runs", [1, 2])
    def test_of_a_derivative(self, runs: int):
        space = DesignSpace(duration=10, samples=20, runs=runs, spline=Spline(coefficients=8))
        sensors = Several(sensors=(YawRate(noise=0.01), PlainRanges()))
        problem = posed_problem(measurement=sensors, design=space)
        # At rest in the first period, at the beacon; the wheel radii have no part in that reading.
        with pytest.raises(NotFinite) as caught:
            evaluate(problem, random_drive(problem, 0))
        assert caught.value.issue.key == ("measurement",)
        text = caught.value.issue.message
        assert text.startswith("the derivative of plain_ranges at 0 s" + (" of run 1" if runs > 1 else ""))
        assert text.endswith("is not finite")
        assert "wheel_radius" in text

    def test_of_a_drive_that_diverges(self):
        problem = posed_problem(model=overflowing())
        inputs = np.zeros((20, 2))
        inputs[7, 0] = 8.5
        drive = Trajectory.from_samples(inputs, 10.0, np.zeros((1, 3)), rest_to_rest=True)
        with pytest.raises(NotFinite, match=r"^robot: x, y: not finite from 3.55 s on$"):
            evaluate(problem, drive)

    def test_of_a_drive_farther_than_anything(self):
        # Of numbers that its record could not hold.
        problem = posed_problem()
        drive = Trajectory.from_samples(np.full((20, 2), 2e13), 10.0, np.zeros((1, 3)), rest_to_rest=False)
        with pytest.raises(NotFinite, match=r"^robot: x: beyond 1e\+12 from 1.05 s on$"):
            evaluate(problem, drive)

    def test_of_a_limit(self):
        problem = posed_problem(limits=(SPEED, ACCELERATION, BOX, Nowhere()))
        with pytest.raises(NotFinite, match=r"^limits.nowhere: not a number"):
            evaluate(problem, random_drive(problem, 0))

    def test_it_survives_the_way_from_a_worker(self):
        error = NotFinite(oed.foundation.errors.Issue(("robot",), "x: not finite"))
        again = pickle.loads(pickle.dumps(error))
        assert (str(again), again.issue) == (str(error), error.issue)


class TestWhatIsDone:
    def test_a_problem_without_any_finite_drive_is_refused(self):
        with pytest.raises(NotFinite, match="plain_ranges at 0 s"):
            require_identifiable(posed_problem(measurement=PlainRanges()))

    def test_a_problem_with_some_is_not(self):
        assert ambiguities(posed_problem(model=overflowing())) == ()

    @pytest.mark.slow
    def test_searches_pass_them_over(self):
        problem = posed_problem(model=overflowing())
        for solver in (
            oed.Ipopt(starts=2, perturbations=0, second_stage="none", max_iterations=4),
            oed.Genetic(population=20, generations=3),
        ):
            found = oed.solve(problem, solver, seed=0, workers=1)
            assert found.evaluation is None or np.isfinite(found.evaluation.path).all()

    @pytest.mark.slow
    def test_a_search_of_nothing_else_says_why(self, monkeypatch: pytest.MonkeyPatch):
        # Where the random drives asked first happened to be finite.
        monkeypatch.setattr("oed.optimize.require_identifiable", lambda problem: None)
        options = oed.Ipopt(starts=2, perturbations=0, second_stage="none")
        found = oed.solve(posed_problem(measurement=PlainRanges()), options, seed=0, workers=1)
        assert found.status is Status.FAILED
        assert "the derivative of plain_ranges at 0 s" in found.message

    def test_a_baseline_of_nothing_else_has_no_score(self):
        (straight,) = baselines(posed_problem(measurement=PlainRanges()), "straight")
        assert (straight.status, straight.evaluation) == (Status.UNSCORED, None)
        assert "the derivative of plain_ranges at 0 s" in straight.message


@pytest.mark.parametrize("name", ["straight", "circle", "random"])
@pytest.mark.slow
def test_a_limit_of_changes_keeps_a_drive_of_one_sample(name: str):
    space = DesignSpace(duration=2, samples=1, spline=Spline(coefficients=8))
    problem = posed_problem(limits=(SPEED, ACCELERATION, WheelJerk(bounds=30.0), BOX), design=space)
    (found,) = baselines(problem, name)
    assert found.evaluation is not None
    assert "wheel_jerk" not in found.evaluation.violations
