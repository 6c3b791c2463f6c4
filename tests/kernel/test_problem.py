"""A problem's parts fit together, or every reason why not is listed."""

from __future__ import annotations

import pickle
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import pytest
from builders import ACCELERATION, BOX, RADIUS, SPEED, TRACK, problem_of, random_drive

from oed.foundation.errors import ProblemError, UserMistake
from oed.kernel.criteria import A, E
from oed.kernel.dynamics.space import Spline
from oed.kernel.evaluation import evaluate
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.robots.limits import WheelSpeed
from oed.robots.models import DifferentialDrive, Input, Model, Parameter, SkidSteer
from oed.robots.sensors import Displacements, Poses, Ranges, Several, YawRate
from oed.robots.space import DesignSpace, StartPose


class Unicycle(Model):
    """A user's own robot: speed and yaw rate are the inputs themselves."""

    kind: Literal["unicycle"] = "unicycle"
    inputs: ClassVar[tuple[Input, ...]] = (Input("speed", "speed", "m/s"), Input("yaw_rate", "turn", "rad/s"))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gain", 1.0, ""),)

    def twist(self, inputs, parameters):
        return ca.vertcat(parameters[0] * inputs[0], 0, inputs[1])


class MotorSpeed(WheelSpeed):
    """A user's own limit, which bounds the same inputs as another."""

    name: ClassVar[str] = "motor_speed"


def issues_of(**overrides) -> dict[str, str]:
    with pytest.raises(ProblemError) as caught:
        problem_of(**overrides)
    return {".".join(map(str, issue.key)): issue.message for issue in caught.value.issues}


def test_the_builders_problem_is_valid():
    problem = problem_of()
    np.testing.assert_array_equal(problem.input_bounds, [[-10, 10], [-10, 10]])


@pytest.mark.parametrize("order", [1, -1])
def test_limits_on_the_same_inputs_bound_them_together(order: int):
    limits = (WheelSpeed(bounds=(-2, 8)), MotorSpeed(bounds=(-5, 5)))[::order]
    np.testing.assert_array_equal(problem_of(limits=limits).input_bounds, [[-2, 5], [-2, 5]])


BREACHES = {
    "few coefficients": (
        {"design": DesignSpace(duration=10, samples=40, spline=Spline(coefficients=5))},
        "trajectory.spline.coefficients",
        "at rest at both ends needs at least 6 coefficients, got 5",
    ),
    "few coefficients without rest": (
        {"design": DesignSpace(duration=10, samples=40, spline=Spline(coefficients=3), rest_to_rest=False)},
        "trajectory.spline.coefficients",
        "needs at least 4 coefficients, got 3",
    ),
    "limit twice": ({"limits": (SPEED, SPEED)}, "limits.wheel_speed", "given twice"),
    "start outside": (
        {"design": DesignSpace(duration=10, start=StartPose(x=2))},
        "limits.workspace",
        "lies outside the workspace",
    ),
    "no rest possible": ({"limits": (WheelSpeed(bounds=(1, 2)),)}, "limits.wheel_speed", "excludes 0"),
    "unbounded wheels": ({"limits": (BOX, ACCELERATION)}, "limits", "nothing bounds wheel_speed"),
    "no limits": ({"limits": ()}, "limits", "nothing bounds wheel_speed"),
    "many segments": (
        {"measurement": Displacements(segments=41)},
        "measurement.segments",
        "at most as many segments as there are samples (40), got 41",
    ),
    "one heading": (
        {"measurement": Displacements(segments=1, regressor="heading")},
        "measurement.segments",
        "expected at least 2 segments, got 1",
    ),
    "one heading of both": (
        {"measurement": Displacements(segments=1, regressor="both")},
        "measurement.segments",
        "expected at least 2 segments, got 1",
    ),
    "no noise": ({"criterion": E()}, "measurement.noise", "position noise is needed"),
    "unknown scale": (
        {
            "criterion": E(scaling={"c21": 1.0, "c22": 1.0, "c11": 1.0}),
            "measurement": Displacements(segments=4, noise={"position": 0.1}),
        },
        "criterion.scaling.c11",
        "the parameters are c21, c22",
    ),
    "robot without coefficients": (
        {"model": Unicycle()},
        "measurement.kind",
        "unicycle is not",
    ),
    "robot without wheels": ({"model": Unicycle()}, "limits.wheel_speed", "its inputs are speed, yaw_rate"),
}


@pytest.mark.parametrize(("overrides", "key", "message"), BREACHES.values(), ids=BREACHES.keys())
def test_every_breach_of_a_valid_problem_is_named(overrides, key, message):
    assert message in issues_of(**overrides)[key]


def test_all_issues_are_listed_at_once():
    found = issues_of(
        design=DesignSpace(duration=10, samples=40, spline=Spline(coefficients=4), start=StartPose(x=3)),
        measurement=Displacements(segments=50),
        limits=(BOX, ACCELERATION),
    )
    assert set(found) == {
        "trajectory.spline.coefficients",
        "limits.workspace",
        "limits",
        "measurement.segments",
    }


def test_an_wrong_problem_is_the_users_mistake():
    with pytest.raises(UserMistake, match="limits: nothing bounds wheel_speed_left; add wheel_speed"):
        problem_of(limits=())


def test_one_segment_is_enough_for_positions():
    assert problem_of(measurement=Displacements(segments=1)).measurement.segment_count(40) == 1


def test_a_problem_is_copied_to_workers_whole():
    problem = problem_of(model=DifferentialDrive(wheel_radius=RADIUS, track=TRACK), name="copied")
    drive = random_drive(problem, 0)
    before = evaluate(problem, drive)
    copy = pickle.loads(pickle.dumps(problem))
    assert copy.name == "copied"
    assert (copy.model, copy.design, copy.limits) == (problem.model, problem.design, problem.limits)
    assert evaluate(copy, drive).objective == before.objective


def test_limits_may_come_as_a_list():
    assert problem_of(limits=[SPEED, BOX]).limits == (SPEED, BOX)


POSES = Poses(noise={"position": 1e-3, "heading": 0.01})
NOISY = Displacements(segments=4, noise={"position": 0.01, "heading": 0.02}, regressor="both")
GEOMETRY = ("wheel_radius_right", "wheel_radius_left", "track")
COEFFICIENTS = ("c11", "c12", "c21", "c22")


def sensed(**overrides) -> Problem:
    """The builders' problem with absolute poses, in SI units."""
    return problem_of(**{"measurement": POSES, "criterion": E(scaling="none"), **overrides})


def joint(problem: Problem, seed: int = 0) -> np.ndarray:
    return evaluate(problem, random_drive(problem, seed)).information["joint"]


class TestEstimate:
    """Which parameters are estimated."""

    WRONG: ClassVar = {
        "unknown name": (("track", "wheelbase"), "got track, wheelbase"),
        "unknown name alone": (("wheel_radius",), "expected some of the robot's parameters"),
        "of both kinds": (("track", "c11"), "or coefficients (c11, c12, c21, c22), got track, c11"),
        "listed twice": (("track", "track"), "a parameter is listed twice"),
        "none": ((), "expected at least one parameter"),
    }

    @pytest.mark.parametrize(("names", "words"), WRONG.values(), ids=WRONG.keys())
    @pytest.mark.parametrize("measurement", [POSES, NOISY], ids=["poses", "displacements"])
    def test_wrong_names_are_issues(self, measurement, names, words: str):
        found = issues_of(measurement=measurement, estimate=names)
        assert list(found) == ["estimate"]
        assert words in found["estimate"]

    @pytest.mark.parametrize(
        ("regressor", "names"), [("both", ("track",)), ("position", ("c11",)), ("heading", ("c21", "c11"))]
    )
    def test_what_displacements_do_not_tell(self, regressor: str, names):
        measurement = Displacements(segments=4, regressor=regressor)
        found = issues_of(measurement=measurement, estimate=names)
        assert list(found) == ["estimate"]
        assert f"{names[0]} cannot be estimated from displacements, which identify c" in found["estimate"]

    def test_a_robot_without_coefficients_names_its_parameters_only(self):
        found = issues_of(model=Unicycle(), measurement=POSES, estimate=("c11",), limits=())
        assert found["estimate"] == "expected some of the robot's parameters (gain), got c11"

    @pytest.mark.parametrize("names", [("track",), ("track", "wheel_radius_right"), GEOMETRY[::-1]])
    def test_the_other_parameters_are_known(self, names):
        # No nuisances: what is left is the chosen part of the whole information.
        known = Poses(noise=POSES.noise, initial_pose="known")
        whole, some = joint(sensed(measurement=known)), joint(sensed(measurement=known, estimate=names))
        chosen = [GEOMETRY.index(name) for name in names]
        np.testing.assert_allclose(some, whole[np.ix_(chosen, chosen)], rtol=1e-12)

    def test_knowing_the_others_is_never_less_informative(self):
        whole = joint(sensed())
        some = joint(sensed(estimate=("wheel_radius_right", "track")))
        left = np.linalg.inv(np.linalg.inv(whole)[np.ix_([0, 2], [0, 2])])
        sizes = np.sqrt(np.diag(some))
        # Of rank one, for one other parameter: what is 0 may be rounding on either side.
        gained = np.linalg.eigvalsh((some - left) / np.outer(sizes, sizes))
        assert gained[0] > -1e-14
        assert gained[1] > 1e-3

    def test_the_order_is_that_of_the_list(self):
        names = ("track", "wheel_radius_left", "wheel_radius_right")
        problem = sensed(estimate=names)
        evaluation = evaluate(problem, random_drive(problem, 0))
        assert evaluation.parameters["joint"] == names
        assert list(evaluation.standard_deviations) == list(names)
        np.testing.assert_allclose(evaluation.information["joint"], joint(sensed())[::-1, ::-1], rtol=1e-9)

    def test_coefficients_may_be_estimated_from_sensors(self):
        problem = sensed(estimate=COEFFICIENTS[1:], criterion=E())
        (estimation,) = problem.any_estimations
        assert estimation.parameters == COEFFICIENTS[1:]
        np.testing.assert_allclose(estimation.nominal, [-RADIUS / TRACK, RADIUS / 2, RADIUS / 2])
        assert estimation.units == ("", "m", "m")

    @pytest.mark.parametrize(
        ("names", "blocks"),
        [(("c21",), {"position": ("c21",)}), (("c22", "c11"), {"heading": ("c11",), "position": ("c22",)})],
    )
    def test_some_coefficients_of_displacements(self, names, blocks):
        problem = problem_of(measurement=NOISY, estimate=names)
        drive = random_drive(problem, 0)
        some, whole = evaluate(problem, drive), evaluate(problem_of(measurement=NOISY), drive)
        assert dict(some.parameters) == blocks
        for name, parameters in blocks.items():
            place = whole.parameters[name].index(parameters[0])
            expected = whole.information[name][place, place]
            np.testing.assert_allclose(some.information[name], [[expected]])

    def test_a_slip_that_is_nominally_zero_may_be_left_out(self):
        model = SkidSteer(wheel_radius=RADIUS, track=TRACK)
        found = issues_of(model=model, measurement=POSES, criterion=E())
        assert "slip_outer, slip_inner is nominally 0" in found["criterion.scaling"]
        problem = sensed(model=model, criterion=E(), estimate=GEOMETRY)
        assert evaluate(problem, random_drive(problem, 0)).lambda_min > 0

    def test_a_criterion_judges_some_of_them(self):
        found = issues_of(measurement=POSES, criterion=E(subset=("track",)), estimate=GEOMETRY[:2])
        assert "got track" in found["criterion.subset"]
        whole, judged = joint(sensed()), joint(sensed(criterion=E(scaling="none", subset=("track",))))
        np.testing.assert_allclose(1 / judged, np.linalg.inv(whole)[2:, 2:], rtol=1e-8)


PRIORS = {
    "deviations": Prior(standard_deviations={"track": "1 mm", "wheel_radius_right": "2 %"}),
    "covariance": Prior(parameters=("track", "wheel_radius_left"), covariance=((1e-6, 2e-7), (2e-7, 8e-8))),
}


class TestPrior:
    """Knowledge from before adds to the information."""

    @staticmethod
    def precision(name: str) -> np.ndarray:
        """By hand, on the right and left radius and the track."""
        matrix = np.zeros((3, 3))
        if name == "deviations":
            matrix[0, 0], matrix[2, 2] = (0.02 * RADIUS) ** -2, 1e6
        else:
            matrix[np.ix_([2, 1], [2, 1])] = np.linalg.inv([[1e-6, 2e-7], [2e-7, 8e-8]])
        return matrix

    @pytest.mark.parametrize("name", PRIORS)
    @pytest.mark.parametrize(
        "measurement",
        [
            POSES,
            Poses(noise=POSES.noise, lever_arm={"x": 0.1, "known": False}),
            Several(sensors=[YawRate(noise=0.01), Ranges(beacons=[(3, 3), (-3, 2)], noise=0.02)]),
        ],
        ids=["poses", "with an arm", "several"],
    )
    def test_it_adds_and_nothing_else(self, measurement, name: str):
        without = joint(sensed(measurement=measurement))
        found = joint(sensed(measurement=measurement, prior=PRIORS[name]))
        scale = 1e-9 * np.trace(without)
        np.testing.assert_allclose(found - without, self.precision(name), rtol=1e-9, atol=scale)

    @pytest.mark.parametrize("name", PRIORS)
    def test_it_is_scaled_as_the_information_is(self, name: str):
        without, found = joint(sensed(criterion=E())), joint(sensed(criterion=E(), prior=PRIORS[name]))
        scales = np.array([RADIUS, RADIUS, TRACK])
        expected = without + self.precision(name) * np.outer(scales, scales)
        np.testing.assert_allclose(found, expected, rtol=1e-9)

    def test_of_parameters_that_are_estimated_but_not_judged(self):
        prior, without = PRIORS["deviations"], joint(sensed())
        judged = E(scaling="none", subset=("wheel_radius_left",))
        found = joint(sensed(criterion=judged, prior=prior))
        covariance = np.linalg.inv(without + self.precision("deviations"))
        np.testing.assert_allclose(1 / found, covariance[1:2, 1:2], rtol=1e-8)

    def test_predicted_covariances_know_of_it(self):
        problem = sensed(prior=PRIORS["covariance"])
        evaluation = evaluate(problem, random_drive(problem, 0))
        expected = np.linalg.inv(joint(sensed()) + self.precision("covariance"))
        np.testing.assert_allclose(evaluation.covariances["joint"], expected, rtol=1e-7)

    @pytest.mark.parametrize("measurement", [POSES, Ranges(beacons=[(3, 3), (-3, 2), (1, -3)], noise=0.02)])
    def test_one_experiment_after_another(self, measurement):
        # The second knows what the first has told; initial poses and the like are each one's own.
        problem = sensed(measurement=measurement)
        first = evaluate(problem, random_drive(problem, 1))
        covariance = first.covariances["joint"]
        prior = Prior(
            parameters=first.parameters["joint"], covariance=((covariance + covariance.T) / 2).tolist()
        )
        both = joint(sensed(measurement=measurement, prior=prior), seed=2)
        total = first.information["joint"] + joint(problem, seed=2)
        np.testing.assert_allclose(both, total, rtol=1e-6)

    def test_displacements_are_divided_by_their_noise_first(self):
        prior = Prior(standard_deviations={"c21": "1 mm", "c11": "3 %"})
        plain, found = (problem_of(measurement=NOISY, criterion=E(), prior=way) for way in (None, prior))
        drive = random_drive(plain, 0)
        before, after = evaluate(plain, drive).information, evaluate(found, drive).information
        share = (RADIUS / 2 / 1e-3) ** 2
        np.testing.assert_allclose(after["position"] - before["position"], np.diag([share, 0]), atol=1e-6)
        np.testing.assert_allclose(after["heading"] - before["heading"], np.diag([0.03**-2, 0]), atol=1e-6)

    def test_it_cannot_be_added_to_what_leaves_the_noise_out(self):
        prior = Prior(standard_deviations={"c21": "1 mm"})
        found = issues_of(measurement=NOISY, criterion=E(scaling="none"), prior=prior)
        assert list(found) == ["prior"]
        assert "cannot be added to W'W" in found["prior"]
        sensed(prior=PRIORS["deviations"])

    def test_it_makes_a_singular_design_regular(self):
        # On yaw rates alone, radii and track are told by their ratios only.
        rates = YawRate(noise=0.01)
        prior = Prior(standard_deviations={"track": "1 mm"})
        blind, seeing = (sensed(measurement=rates, criterion=A(), prior=way) for way in (None, prior))
        drive = random_drive(blind, 0)
        assert evaluate(blind, drive).singular
        assert not evaluate(seeing, drive).singular

    @pytest.mark.parametrize(
        ("prior", "key", "words"),
        [
            (
                Prior(standard_deviations={"slip": 1}),
                "prior.standard_deviations.slip",
                f"slip is not estimated here; the parameters are {', '.join(GEOMETRY)}",
            ),
            (
                Prior(standard_deviations={"track": "1 kg"}),
                "prior.standard_deviations.track",
                "expected a length [m], got '1 kg'",
            ),
            (
                Prior(standard_deviations={"track": "-1 mm"}),
                "prior.standard_deviations.track",
                "expected a positive standard deviation",
            ),
            (
                Prior(parameters=("c11",), covariance=((1.0,),)),
                "prior.parameters",
                "c11 is not estimated here",
            ),
        ],
        ids=["unknown name", "wrong unit", "negative", "covariance of an unknown name"],
    )
    def test_wrong_ones_are_issues(self, prior: Prior, key: str, words: str):
        found = issues_of(measurement=POSES, prior=prior)
        assert list(found) == [key]
        assert words in found[key]

    def test_of_a_parameter_taken_as_known_is_an_issue(self):
        found = issues_of(measurement=POSES, estimate=("track",), prior=PRIORS["deviations"])
        assert set(found) == {"prior.standard_deviations.wheel_radius_right"}
        assert found.popitem()[1].endswith("the parameters are track")

    def test_of_parameters_that_are_estimated_apart(self):
        names, sizes = ("c11", "c12", "c21", "c22"), np.array([0.01, 0.02, 1e-3, 2e-3])
        apart = Prior(standard_deviations=dict(zip(names, sizes, strict=True)))
        together = Prior(parameters=names, covariance=np.diag(sizes**2).tolist())
        found, expected = (
            problem_of(measurement=NOISY, criterion=E(), prior=way) for way in (together, apart)
        )
        drive = random_drive(expected, 0)
        for name, matrix in evaluate(expected, drive).information.items():
            np.testing.assert_allclose(evaluate(found, drive).information[name], matrix, rtol=1e-9)
