"""Condensed drives, against drives written out as a whole."""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from builders import ACCELERATION, BOX, RADIUS, SPEED, TRACK, input_limits, problem_of
from some_instants import SLOTS, chosen_of
from written_out import WrittenOut, called

from oed.kernel.criteria import E
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Spline
from oed.kernel.limit import Limit, Rows
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.optimize.terms import terms_of
from oed.optimize.terms.needs import by_instants, needs_of
from oed.optimize.terms.terms import Terms
from oed.robots.limits import (
    BodySpeed,
    EndHeading,
    EndPosition,
    PathLength,
    TrailerAngle,
    TurningRadius,
    WheelJerk,
    WheelSpeed,
    YawRate,
)
from oed.robots.limits.workspace import Circle, CircularObstacle, Obstacles
from oed.robots.models import Mecanum, SkidSteerSlip, TractorTrailer
from oed.robots.sensors import Displacements, Poses, Ranges, RelativePoses, Several
from oed.robots.sensors import YawRate as Gyroscope
from oed.robots.sensors.mounting import LeverArm
from oed.robots.sensors.prior import PosePrior
from oed.robots.space import DesignSpace, StartPose
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import Uncertainty

SPACE: dict[str, Any] = {"duration": 4, "samples": 8, "spline": Spline(coefficients=6)}
FREE_RUNS = DesignSpace(**{**SPACE, "runs": 2, "start": "free"})
NOISE = {"position": 0.01, "heading": 0.02}
POSES = Poses(noise=NOISE)
ROUND = Obstacles(shapes=(CircularObstacle(kind="circle", x=0.5, y=0.5, radius=0.2),))
EVERYTHING = (
    SPEED,
    ROUND,
    ACCELERATION,
    BodySpeed(bounds=0.4),
    WheelJerk(bounds=90),
    BOX,
    YawRate(bounds=1),
    TurningRadius(bounds=0.1),
)


def at_most(expression: Any, bound: float, unit: str) -> Rows:
    count = expression.shape[0]
    return Rows(expression, np.full(count, -np.inf), np.full(count, bound), bound, unit)


class Bend(Limit):
    """A user's own limit on instants, of the path: x + y^2."""

    name: ClassVar[str] = "bend"
    looks_at: ClassVar = "state"

    def rows(self, drive: Drive) -> Rows:
        x, y = drive.path[:, 0], drive.path[:, 1]
        return at_most(ca.vertcat(x + y**2, x * y), 0.9, "m")


class Power(Limit):
    """A user's own limit on instants, of the motion."""

    name: ClassVar[str] = "power"
    looks_at: ClassVar = "state"

    def rows(self, drive: Drive) -> Rows:
        return at_most(drive.motion[:, 0] ** 2 + 0.1 * drive.motion[:, 2] ** 2, 0.2, "")


class Lagging(Limit):
    """A user's own limit on instants, of the motion and of what is held then."""

    name: ClassVar[str] = "lagging"
    looks_at: ClassVar = "state"

    def rows(self, drive: Drive) -> Rows:
        forward, turning = drive.motion[:, 0], drive.motion[:, 2]
        left, right = drive.inputs[:, 0], drive.inputs[:, 1]
        return at_most(ca.vertcat(forward * left + right**2, ca.sin(left) * forward * turning), 0.9, "")


class Sum(Limit):
    """A user's own limit on the inputs: on the sum of both."""

    name: ClassVar[str] = "sum"
    looks_at: ClassVar = "inputs"

    def rows(self, drive: Drive) -> Rows:
        return at_most(drive.input_values @ ca.DM([1.0, 1.0]), 15.0, "rad/s")


class Unsaid(Bend):
    """The one on the path, which does not say what it looks at."""

    name: ClassVar[str] = "unsaid"
    looks_at: ClassVar = None


class Effort(Limit):
    """Of whole runs: whatever is done at one time counts for all others."""

    name: ClassVar[str] = "effort"

    def rows(self, drive: Drive) -> Rows:
        whole = ca.sqrt(ca.sumsqr(drive.inputs) / drive.samples + 1e-3) + 0.1 * ca.sumsqr(drive.poses[:, 2])
        return at_most(ca.vertcat(whole, drive.input_values[:, 0]), 8.0, "")


class Steps(Unsaid):
    """Says that it looks at instants by themselves, but looks at two of them."""

    name: ClassVar[str] = "steps"
    looks_at: ClassVar = "state"

    def rows(self, drive: Drive) -> Rows:
        return at_most((drive.path[1:, 0] - drive.path[:-1, 0]) ** 2, 0.1, "m")


class Splines(Sum):
    """Says so too, but looks at the splines."""

    name: ClassVar[str] = "splines"
    looks_at: ClassVar = "state"


class Held(Unsaid):
    """Says that it looks at the inputs' splines, but looks at the motion."""

    name: ClassVar[str] = "held"
    looks_at: ClassVar = "inputs"

    def rows(self, drive: Drive) -> Rows:
        return at_most(drive.motion[:, 0] ** 2, 0.2, "")


class Product(Sum):
    """On the product of both inputs, which is not linear in them."""

    name: ClassVar[str] = "product"

    def rows(self, drive: Drive) -> Rows:
        return at_most(drive.input_values[:, 0] * drive.input_values[:, 1], 60.0, "")


class Begin(Limit):
    """On where a run begins: moved by no unknown where that is fixed."""

    name: ClassVar[str] = "begin"

    def rows(self, drive: Drive) -> Rows:
        first, _ = drive.ends_of(drive.path)
        return at_most(ca.vec(first), 1.0, "")


class Step(Limit):
    """On how far a run goes in its first sample: where it stands still, the slope is not finite."""

    name: ClassVar[str] = "step"

    def rows(self, drive: Drive) -> Rows:
        first = drive.poses[1, :2] - drive.poses[0, :2]
        return at_most(ca.sqrt(ca.sumsqr(first)), 1.0, "m")


class Mean(Limit):
    """On the mean of what is held in a whole run, which the first step is of as well; linear."""

    name: ClassVar[str] = "mean"

    def rows(self, drive: Drive) -> Rows:
        return at_most(ca.vertcat(ca.sum1(drive.inputs[:, 0]), ca.sum1(drive.inputs[:, 1])) / 24, 5.0, "")


OWN = (Bend(), SPEED, Power(), Sum(), BOX)
WHOLE_RUNS = (
    EndPosition(at="start"),
    SPEED,
    Effort(),
    BOX,
    Unsaid(),
    Bend(),
    EndHeading(at="start"),
    PathLength(bounds=3),
)


def space(**changes: Any) -> DesignSpace:
    return DesignSpace(**{**SPACE, **changes})


QUICK = (
    "heading",
    "both",
    "coefficients from poses",
    "midpoint, no rest",
    "trapezoids of one coefficient",
    "steps",
    "a limit on what is fixed",
    "an end alone",
)
"""Those that are tried every time."""
PROBLEMS: dict[str, dict[str, Any]] = {
    "heading": {"measurement": Displacements(segments=4, regressor="heading")},
    "both": {"measurement": Displacements(segments=4, regressor="both")},
    "coefficients from poses": {"measurement": POSES, "estimate": ("c11", "c12", "c21", "c22")},
    "segments of several pieces": {"measurement": Displacements(segments=2), "design": space(samples=48)},
    "per sample, of runs": {"measurement": Displacements(segments="samples"), "design": FREE_RUNS},
    "runs from free starts": {"design": space(runs=2, start="free"), "limits": EVERYTHING},
    "midpoint, no rest": {"design": space(integration="midpoint", rest_to_rest=False)},
    "trapezoids of one coefficient": {
        "design": space(spline=Spline(degree=1, coefficients=7)),
        "estimate": ("c21",),
    },
    "steps": {"design": space(spline=Spline(degree=0, coefficients=8)), "limits": EVERYTHING[:4]},
    "own limits from free starts": {"limits": OWN, "design": FREE_RUNS, "measurement": POSES},
    "whole runs from free starts": {"limits": WHOLE_RUNS, "design": FREE_RUNS, "measurement": POSES},
    "a limit on what is fixed": {"limits": (SPEED, Begin())},
    "a limit on free starts": {"limits": (SPEED, Begin(), BOX), "design": FREE_RUNS},
    "an end alone": {"limits": (SPEED, EndPosition(at={"x": 0.5, "y": 0}))},
    "other limits than they say": {"limits": (Steps(), SPEED, Splines(), Held(), Product(), BOX)},
    "sideways": {
        "model": Mecanum(wheel_radius=0.05, half_wheelbase_plus_half_track=0.35),
        "limits": EVERYTHING[:4],
    },
    "poses, sometimes, of a known start": {
        "measurement": Poses(noise=NOISE, every=3, initial_pose="known"),
        "limits": EVERYTHING,
        "design": space(samples=12),
    },
    "start with a prior": {
        "measurement": Poses(noise=NOISE, initial_pose=PosePrior(position=0.02, heading=0.05)),
        "design": space(start="free"),
        "limits": (SPEED, Circle(radius=2), ROUND),
    },
    "poses of runs": {
        "measurement": POSES,
        "design": space(runs=2, start=(StartPose(), StartPose(x=0.2, heading=1.0))),
    },
    "relative poses": {"measurement": RelativePoses(noise={**NOISE, "position_per_speed": 0.05})},
    "prime samples": {"measurement": POSES, "design": space(samples=53)},
    "readings at odd times": {"measurement": Poses(noise=NOISE, every=5)},
    "lever arm": {"measurement": Poses(noise=NOISE, lever_arm=LeverArm(x=0.05, known=False, deviation=0.01))},
    "constants of a sensor": {
        "measurement": RelativePoses(noise=NOISE, mounting={"x": 0.1, "y": -0.04, "heading": 0.3}),
        "estimate": ("wheel_radius_left", "track", "sensor_x", "sensor_heading"),
    },
    "constants of a sensor alone": {
        "measurement": RelativePoses(noise=NOISE, mounting={"x": 0.1, "y": -0.04, "heading": 0.3}),
        "estimate": ("sensor_heading", "sensor_x"),
    },
    "two sensors": {
        "measurement": Several(
            sensors=(
                Ranges(beacons=((3, 0), (0, 3), (2, 2)), noise=0.05, every=2),
                Gyroscope(noise=0.01),
            )
        ),
        "design": space(runs=2),
    },
    "subset with a prior": {
        "measurement": POSES,
        "estimate": ("wheel_radius_left", "track"),
        "criterion": E(scaling="relative", subset=("track",)),
        "prior": Prior(standard_deviations={"wheel_radius_left": 1e-3}),
    },
    "trailer": {
        "model": TractorTrailer(wheel_radius=RADIUS, track=TRACK, hitch_offset=0.1, trailer_length=0.4),
        "measurement": POSES,
        "limits": (SPEED, TrailerAngle(bounds=1), BOX),
    },
    "lag": {
        "model": SkidSteerSlip(wheel_radius=RADIUS, track=TRACK, yaw_lag=0.3),
        "measurement": POSES,
        "limits": (SPEED, YawRate(bounds=2), BOX, Power(), Effort()),
    },
}
WIDTHS = {"track": 0.05, "wheel_radius_left": 0.03}
UNCERTAIN: dict[str, Any] = {
    "criterion": E(scaling="relative"),
    "measurement": POSES,
    "uncertainty": Uncertainty(within=WIDTHS),
    "robust": Robust(),
}
PROBLEMS |= {
    "unequal segments": {"measurement": Displacements(segments=5)},
    "shared noise": {"measurement": Displacements(segments=4, noise_model="absolute")},
    "shared noise of runs from free starts": {
        "measurement": Displacements(segments=4, noise_model="absolute"),
        "design": FREE_RUNS,
        "limits": EVERYTHING,
    },
    "readings across samples": {"measurement": RelativePoses(noise=NOISE, every=2)},
    "robust": UNCERTAIN,
    "robust, of runs from uncertain free starts": {
        **UNCERTAIN,
        "uncertainty": Uncertainty(within={**WIDTHS, "x": 0.02, "heading": 0.05}),
        "design": FREE_RUNS,
        "limits": (*EVERYTHING, PathLength(bounds=3)),
    },
    "robust for robots that drive": {**UNCERTAIN, "robust": Robust(kind="scenarios")},
    "robust for the worst of robots": {
        **UNCERTAIN,
        "robust": Robust(kind="scenarios", objective="worst"),
        "uncertainty": Uncertainty(within={**WIDTHS, "y": 0.02}),
        "limits": (*EVERYTHING[:4], PathLength(bounds=3), BOX),
    },
    "robust for the mean, and another robot": {
        **UNCERTAIN,
        "robust": Robust(objective="mean", added_scenarios=((RADIUS * 1.02, TRACK * 0.97),)),
        "design": space(runs=2),
    },
    "robust for the mean, of segments": {
        **UNCERTAIN,
        "measurement": Displacements(segments=4, noise=NOISE),
        "robust": Robust(objective="mean"),
    },
    "robust for the mean, of shared noise": {
        **UNCERTAIN,
        "measurement": RelativePoses(noise=NOISE, every=2),
        "robust": Robust(objective="mean"),
    },
    "robust lag": {
        **UNCERTAIN,
        "model": SkidSteerSlip(wheel_radius=RADIUS, track=TRACK, yaw_lag=0.3),
        "limits": (SPEED, YawRate(bounds=2), BOX),
    },
}


small_problem = partial(problem_of, **SPACE)


def assert_close(found: Any, expected: Any, weight: float = 1e-9) -> None:
    """Equal to nine digits of the largest entry."""
    found, expected = np.array(found), np.array(expected)
    size = np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=weight * size)


@pytest.mark.parametrize(
    "overrides",
    [
        pytest.param(PROBLEMS[name], id=name, marks=() if name in QUICK else pytest.mark.slow)
        for name in PROBLEMS
    ],
)
def test_they_say_what_the_whole_drive_says(overrides: dict[str, Any]):
    problem = small_problem(**overrides)
    agree(problem, Terms(problem), WrittenOut(problem))


@pytest.mark.slow
def test_a_slope_that_is_not_finite_spoils_no_other_limit():
    problem = small_problem(limits=(Step(), SPEED, Mean()), design=space(rest_to_rest=False))
    terms = Terms(problem)
    both = called(terms), WrittenOut(problem).functions()
    found, expected = (np.array(functions.jacobian(np.zeros(terms.size))[1]) for functions in both)
    spoilt = np.isnan(expected).any(axis=1)
    assert 0 < spoilt.sum() < len(spoilt)
    np.testing.assert_array_equal(np.isnan(found).any(axis=1), spoilt)
    assert_close(found[~spoilt], expected[~spoilt])


def test_second_derivatives_with_more_entries_in_a_row_than_unknowns_are_not_coloured(
    monkeypatch: pytest.MonkeyPatch,
):
    # It would take as long as the number of samples, cubed.
    monkeypatch.setattr(ca.Sparsity, "uni_coloring", lambda _: pytest.fail("coloured"))
    condensed = Terms(small_problem(limits=(Effort(), SPEED)))
    rows = sum(len(one.lower) for one in condensed.rows)
    z = np.zeros(condensed.size)
    called(condensed).hessian(z, np.ones(condensed.entry_count), np.ones(rows))


@pytest.mark.slow
@pytest.mark.parametrize("limits", [EVERYTHING, (*OWN, Unsaid())])
def test_so_do_drives_limited_between_the_samples(limits: tuple[Limit, ...]):
    problem = small_problem(limits=limits, design=FREE_RUNS)
    agree(problem, Terms(problem, 3), WrittenOut(problem, 3))


def agree(problem: Problem, condensed: Terms, whole: WrittenOut) -> None:
    rng = np.random.default_rng(0)
    assert (condensed.size, condensed.sizes) == (whole.size, whole.sizes)
    assert condensed.linear == whole.linear
    for found, expected in zip(condensed.rows, whole.rows, strict=True):
        np.testing.assert_array_equal(found.lower, expected.lower)
        np.testing.assert_array_equal(found.upper, expected.upper)
        assert (found.size, found.unit) == (expected.size, expected.unit)
    z = rng.uniform(-0.8, 0.8, whole.size)
    for found, expected in zip(condensed.scored(z[None]), whole.scored(z[None]), strict=True):
        assert_close(found, expected)
    chosen = chosen_of(condensed, rng)
    own, others = called(condensed, chosen), whole.functions(condensed, chosen)
    for name in ("values", "jacobian"):
        both = (getattr(functions, name)(z) for functions in (own, others))
        for found, expected in zip(*both, strict=True):
            assert_close(np.array(found).ravel(), np.array(expected).ravel())
    rows = condensed.entries_of_rows(0 if chosen is None else len(chosen)).count
    weights = rng.normal(size=whole.entry_count), rng.normal(size=rows)
    for entries in (0, 1):
        for limits in (0, 1):
            both = entries * weights[0], limits * weights[1]
            assert_close(own.hessian(z, *both), others.hessian(z, *both))


@pytest.mark.slow
@pytest.mark.parametrize("limits", [(Lagging(),), (BodySpeed(bounds=0.4), BOX)])
def test_rows_of_instants_bend_as_their_slopes_change(limits: tuple[Limit, ...]):
    terms = Terms(small_problem(limits=(SPEED, *limits), design=space(runs=2)))
    rng = np.random.default_rng(2)
    z, own = rng.uniform(-0.8, 0.8, terms.size), called(terms, chosen_of(terms, rng))
    weights = np.zeros(own.values(z)[1].shape[0])
    weights[-SLOTS:] = rng.normal(size=SLOTS)

    def gradient(at: np.ndarray, of_rows: int) -> np.ndarray:
        if of_rows:
            return np.array(own.jacobian(at)[1].T @ weights).ravel()
        return np.array([weights @ np.array(own.values(at)[1]).ravel()])

    steps = 1e-5 * np.eye(len(z))
    slopes, bends = (
        np.array([(gradient(z + one, part) - gradient(z - one, part)) / 2e-5 for one in steps])
        for part in (0, 1)
    )
    np.testing.assert_allclose(slopes.ravel(), gradient(z, 1), atol=1e-7)
    found = np.triu(np.array(own.hessian(z, np.zeros(terms.entry_count), weights)))
    assert np.abs(found).max() > 0.1
    np.testing.assert_allclose(found, np.triu(bends), atol=1e-7)


def test_a_limit_is_asked_of_what_it_looks_at():
    problem = small_problem(
        limits=(*OWN, EndHeading(at="start"), Unsaid(), Steps(), Splines(), Held(), Product())
    )
    needs = needs_of(problem, terms_of(problem).bounding)
    names = [limit.name for limit in problem.limits]
    assert [names[place] for place in needs.tables] == ["wheel_speed", "sum"]
    assert [names[place] for place in needs.instants] == ["bend", "power", "workspace"]
    whole = [names[place] for place in needs.whole]
    assert whole == ["end_heading", "unsaid", "steps", "splines", "held", "product"]


def test_a_lag_has_two_motions_in_a_sample():
    lag = small_problem(**PROBLEMS["lag"])
    assert by_instants(lag, Power())
    assert terms_of(lag).instants.asking is False


@pytest.mark.slow
def test_scores_and_bounded_unknowns_agree():
    problem = small_problem(limits=(*EVERYTHING, *WHOLE_RUNS[::2]))
    condensed, whole = Terms(problem), WrittenOut(problem)
    z = np.random.default_rng(1).uniform(-3, 3, (5, whole.size))
    for found, expected in zip(condensed.scored(z), whole.scored(z), strict=True):
        assert_close(found, expected)
    for found, expected in zip(condensed.bounded_unknowns, whole.bounded_unknowns, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("measurement", "more"),
    [
        (Displacements(segments=10), ()),
        pytest.param(POSES, (Bend(),), marks=pytest.mark.slow),
        pytest.param(
            Displacements(segments=10),
            (EndPosition(at="start"), PathLength(bounds=3), Unsaid()),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["segments", "own limit", "whole runs"],
)
def test_building_does_not_grow_with_the_samples(measurement, more):
    counts = []
    for samples in (100, 1000):
        limits = (SPEED, ACCELERATION, BOX, *more)
        problem = small_problem(measurement=measurement, samples=samples, limits=limits)
        terms = terms_of(problem)
        counts.append(terms.written)
    assert counts[1] <= counts[0] + 20
    assert (len(terms.rows[2].lower), terms.instants.count) == (0, 2 if not more else terms.instants.count)


@pytest.mark.slow
def test_wheels_that_cannot_reach_full_speed_are_scaled_alike():
    problem = small_problem(limits=(WheelSpeed(bounds=(-2, 8)), BOX))
    z = np.random.default_rng(2).uniform(-1, 1, WrittenOut(problem).size)
    assert_close(terms_of(problem).at(z).entries[:, None], WrittenOut(problem).functions().values(z)[0])


@pytest.mark.slow
def test_input_limits_alone_leave_no_rows_of_instants():
    problem = small_problem(limits=input_limits, measurement=POSES)
    terms, whole = called(terms_of(problem)), WrittenOut(problem).functions()
    z, rows = np.full(terms_of(problem).size, 0.3), sum(len(one.lower) for one in terms_of(problem).rows)
    weights = np.ones(terms_of(problem).entry_count)
    assert_close(terms.jacobian(z)[1], ca.densify(whole.jacobian(z)[1]))
    assert_close(terms.hessian(z, weights, np.ones(rows)), whole.hessian(z, weights, np.ones(rows)))
