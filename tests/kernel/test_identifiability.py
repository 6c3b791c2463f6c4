"""Which parameters no drive tells apart, in words: laws of slip, and plain loops to try the words by."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
import oracle
import pytest
from builders import RADIUS, SPEED, TRACK, input_limits, new_problem_of, problem_of, random_drive
from sample_robots import ROBOTS, Example

import oed
from oed.foundation.errors import ProblemError
from oed.kernel.criteria import D, E
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.identifiability import STEP, ambiguities, require_identifiable
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.kernel.solution import Solution
from oed.optimize import Context, Ipopt, Solver
from oed.robots.models import DifferentialDrive, Model, Parameter, SkidSteer
from oed.robots.models.wheels import TWO_WHEEL_SPEEDS
from oed.robots.sensors import Displacements, Measurement, Poses, Ranges, Several, TrailerAngle, YawRate
from oed.robots.space import DesignSpace, StartPose

OUTER, INNER = 0.1, -0.05
POSES = Poses(noise={"position": 2e-3, "heading": 0.02})
HEADINGS = Poses(quantities=("heading",), noise={"heading": 0.02})
GYRO = YawRate(noise=0.01)
RANGES = Ranges(beacons=((4, 3), (-3, 2)), noise=0.01)
START = (0.2, -0.1, 0.4)


class OneRadius(Model):
    """Two sides with one wheel radius and a slip each; a law says which slip a side has."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        first, second = self.slips
        return (
            Parameter("radius", RADIUS, "m"),
            Parameter("track", TRACK, "m"),
            Parameter(first, OUTER, ""),
            Parameter(second, INNER, ""),
        )

    inputs: ClassVar = TWO_WHEEL_SPEEDS
    slips: ClassVar[tuple[str, str]]

    def sides(self, inputs: Expression, first: Expression, second: Expression):
        """Slip of the right and of the left side."""
        raise NotImplementedError

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        radius, track, first, second = (parameters[index] for index in range(4))
        right_slip, left_slip = self.sides(inputs, first, second)
        right = radius * inputs[0] * (1 - right_slip)
        left = radius * inputs[1] * (1 - left_slip)
        return ca.vertcat((right + left) / 2, 0, (right - left) / track)


class SlipOfEachSide(OneRadius):
    """A constant slip of the right and of the left side."""

    kind: Literal["slip_of_each_side"] = "slip_of_each_side"
    slips: ClassVar = ("slip_right", "slip_left")

    def sides(self, inputs, first, second):
        return first, second


class SlipInCurves(OneRadius):
    """A slip of the outer and of the inner side of a curve; none on a straight."""

    kind: Literal["slip_in_curves"] = "slip_in_curves"
    slips: ClassVar = ("slip_outer", "slip_inner")
    width: float = 0.5

    def sides(self, inputs, first, second):
        turning = ca.tanh((inputs[0] - inputs[1]) / self.width)
        right_is_outer = (1 + turning) / 2
        right = second + (first - second) * right_is_outer
        left = first + (second - first) * right_is_outer
        return turning**2 * right, turning**2 * left


class TwoRadii(SlipOfEachSide):
    """A radius and a slip for each side."""

    kind: Literal["two_radii"] = "two_radii"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter("radius_right", RADIUS, "m"),
            Parameter("radius_left", RADIUS, "m"),
            Parameter("track", TRACK, "m"),
            Parameter("slip_right", OUTER, ""),
            Parameter("slip_left", INNER, ""),
        )

    def twist(self, inputs, parameters):
        right = parameters[0] * inputs[0] * (1 - parameters[3])
        left = parameters[1] * inputs[1] * (1 - parameters[4])
        return ca.vertcat((right + left) / 2, 0, (right - left) / parameters[2])


DIFFERENTIAL = DifferentialDrive(wheel_radius=RADIUS, track=TRACK)
SKID = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=OUTER, slip_inner=INNER)
SKID_NAMES = ("wheel_radius_right", "wheel_radius_left", "track", "slip_outer", "slip_inner")
C = ("c11", "c12", "c21", "c22")


posed_anew = partial(
    new_problem_of,
    measurement=POSES,
    limits=(SPEED,),
    criterion=E(),
    start=StartPose(x=START[0], y=START[1], heading=START[2]),
)
posed_problem = cache(posed_anew)
found_in = cache(ambiguities)


def names_of(problem: Problem) -> list[tuple[str, ...]]:
    """The parameters of each combination that no drive tells."""
    return [tuple(ambiguity.changes) for ambiguity in ambiguities(problem)]


def piecewise(*pieces: Sequence[float]) -> Trajectory:
    """Wheel speeds held for equal parts of 40 samples."""
    count = 40 // len(pieces)
    return Trajectory.from_samples(
        np.repeat(pieces, count, axis=0), count * len(pieces) / 4, START, rest_to_rest=False
    )


def rank(problem: Problem, drive: Trajectory) -> int:
    """How many combinations of parameters a drive tells."""
    eigenvalues = np.linalg.eigvalsh(evaluate(problem, drive).information["joint"])
    return int(np.count_nonzero(eigenvalues > 1e-9 * eigenvalues[-1]))


STRAIGHT, ARC, OTHER_ARC, MIRRORED = (4.0, 4.0), (6.0, 2.0), (8.0, 1.0), (2.0, 6.0)


class TestSlipLaws:
    """Which of r, B and two slips a drive tells, by the law that the slips follow."""

    @pytest.mark.parametrize(
        ("model", "pieces", "expected"),
        [
            (SlipOfEachSide(), (ARC,), 2),
            (SlipOfEachSide(), (STRAIGHT, ARC), 3),
            (SlipOfEachSide(), (STRAIGHT, ARC, OTHER_ARC, MIRRORED), 3),
            (SlipInCurves(), (STRAIGHT,), 1),
            (SlipInCurves(), (ARC,), 2),
            (SlipInCurves(), (ARC, MIRRORED), 2),
            (SlipInCurves(), (STRAIGHT, ARC), 3),
            (SlipInCurves(), (STRAIGHT, ARC, MIRRORED), 3),
            (SlipInCurves(), (ARC, OTHER_ARC), 3),
            (SlipInCurves(), (STRAIGHT, ARC, OTHER_ARC), 4),
        ],
    )
    def test_ranks_of_drives(self, model: Model, pieces, expected: int):
        assert rank(posed_problem(model=model), piecewise(*pieces)) == expected

    def test_a_constant_slip_of_each_side_leaves_one_combination(self):
        # Only r (1 - i_R), r (1 - i_L) and B show.
        problem = posed_problem(model=SlipOfEachSide())
        (found,) = found_in(problem)
        share = dict(found.changes)
        assert share == pytest.approx(
            {
                "radius": STEP * RADIUS,
                "slip_right": STEP * (1 - OUTER),
                "slip_left": STEP * (1 - INNER),
            },
            rel=1e-5,
        )
        assert rank(problem, random_drive(problem, 1)) == 3

    def test_two_radii_leave_two(self):
        found = found_in(posed_problem(model=TwoRadii()))
        assert {tuple(one.changes) for one in found} == {
            ("radius_right", "slip_right"),
            ("radius_left", "slip_left"),
        }
        for one in found:
            radius, slip = one.changes.values()
            nominal = OUTER if "slip_right" in one.changes else INNER
            assert slip / radius == pytest.approx((1 - nominal) / RADIUS, rel=1e-5)

    @pytest.mark.parametrize("width", [0.1, 0.5, 3.0])
    def test_slip_in_curves_alone_is_told(self, width: float):
        problem = posed_problem(model=SlipInCurves(width=width))
        assert ambiguities(problem) == ()
        require_identifiable(problem)

    @pytest.mark.slow
    def test_slip_on_straights_too_is_not(self):
        assert names_of(posed_problem(model=SKID)) == [
            ("wheel_radius_right", "wheel_radius_left", "slip_outer", "slip_inner")
        ]
        with pytest.raises(ProblemError, match="slip_outer and slip_inner cannot be identified separately"):
            require_identifiable(posed_problem(model=SKID))

    @pytest.mark.parametrize(
        ("known", "told"),
        [
            ((), False),
            (("track",), False),
            (("wheel_radius_left",), True),
            (("slip_outer",), True),
            (("slip_outer", "slip_inner"), True),
        ],
        ids=lambda value: "+".join(value) or "nothing" if isinstance(value, tuple) else str(value),
    )
    def test_until_one_of_them_is_known(self, known: tuple[str, ...], told: bool):
        problem = posed_problem(model=SKID, estimate=tuple(name for name in SKID_NAMES if name not in known))
        assert (ambiguities(problem) == ()) == told
        assert (
            np.isfinite(list(evaluate(problem, random_drive(problem, 1)).standard_deviations.values())).all()
            == told
        )


class TestIdentifiable:
    """No false alarm."""

    @pytest.mark.parametrize(
        "parts",
        [
            {"model": DIFFERENTIAL},
            {"model": DIFFERENTIAL, "measurement": RANGES},
            {"model": DIFFERENTIAL, "measurement": Several(sensors=[GYRO, RANGES])},
            {"model": DIFFERENTIAL, "measurement": HEADINGS, "estimate": ("c11", "c12")},
            {
                "model": DIFFERENTIAL,
                "measurement": GYRO,
                "estimate": ("wheel_radius_right", "wheel_radius_left"),
            },
            {"model": DIFFERENTIAL, "estimate": C},
            {"model": SKID, "estimate": C},
            {"model": SKID, "estimate": ("track", "slip_outer", "slip_inner")},
            {
                "model": DIFFERENTIAL,
                "measurement": Poses(noise=POSES.noise, lever_arm={"x": 0.1, "known": False}),
            },
            {
                "model": DIFFERENTIAL,
                "measurement": Displacements(regressor="both"),
                "criterion": E(scaling="none"),
            },
            {"model": SKID, "measurement": Displacements(segments=4), "criterion": E(scaling="none")},
            {
                "model": SkidSteer(wheel_radius=RADIUS, track=TRACK),
                "estimate": ("track", "slip_outer", "slip_inner"),
                "criterion": E(scaling={"track": 1e-3, "slip_outer": 0.1, "slip_inner": 0.1}),
            },
        ],
        ids=range(12),
    )
    def test_nothing_is_found(self, parts: dict[str, Any]):
        problem = posed_anew(**parts)
        assert ambiguities(problem) == ()
        require_identifiable(problem)

    @pytest.mark.parametrize("scaling", ["relative", "none", "mapping"])
    def test_whatever_the_scaling(self, scaling: str):
        scales = {"wheel_radius_right": 1e-4, "wheel_radius_left": 10.0, "track": 1.0}
        own = scales if scaling == "mapping" else scaling
        assert ambiguities(posed_anew(model=DIFFERENTIAL, criterion=E(scaling=own))) == ()
        (found,) = ambiguities(posed_anew(model=DIFFERENTIAL, measurement=GYRO, criterion=E(scaling=own)))
        assert dict(found.relative) == pytest.approx(dict.fromkeys(scales, STEP), rel=1e-5)

    def test_what_is_not_judged_need_not_be_told(self):
        # The track is told whatever the radii and slips are.
        problem = posed_problem(model=SKID, criterion=E(subset=("track",)))
        assert ambiguities(problem) == ()

    @pytest.mark.parametrize(
        "slip",
        [1e-3, 1e-5],
    )
    def test_a_small_slip(self, slip: float):
        # However small it is, it is told to 0.7 %.
        model = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=slip, slip_inner=0.05)
        assert found_in(posed_problem(model=model, estimate=("track", "slip_outer", "slip_inner"))) == ()

    @pytest.mark.parametrize("noise", [1e-3, 1e-4])
    def test_sensors_of_very_different_quality(self, noise: float):
        # A very good gyro tells r_R / B and r_L / B, poor positions how large the robot is: to a third.
        poor = Poses(quantities=("x", "y"), noise={"position": 0.1})
        problem = posed_problem(model=DIFFERENTIAL, measurement=Several(sensors=[YawRate(noise=noise), poor]))
        drive = random_drive(problem, 1, 10.0)
        assert evaluate(problem, drive).standard_deviations["track"] < 0.4 * TRACK
        assert ambiguities(problem) == ()


class TestSubset:
    """A criterion of some parameters asks for these alone; the others may hide them all the same."""

    NAMES = ("wheel_radius_right", "slip_inner")

    @pytest.mark.parametrize("name", NAMES)
    def test_one_that_the_others_hide_is_refused(self, name: str):
        problem = posed_problem(model=SKID, criterion=E(subset=(name,)))
        assert evaluate(problem, random_drive(problem, 1)).standard_deviations[name] == np.inf
        with pytest.raises(ProblemError, match=name):
            require_identifiable(problem)

    @pytest.mark.parametrize("name", NAMES)
    def test_one_among_others_is_refused(self, name: str):
        with pytest.raises(ProblemError, match=name):
            require_identifiable(posed_problem(model=SKID, criterion=E(subset=(name, "track"))))

    def test_it_is_not_said_to_change_nothing_by_itself(self):
        # The outer slip does change what is measured; it is the radii that undo it.
        (found,) = found_in(posed_problem(model=SKID, criterion=E(subset=("slip_outer", "track"))))
        assert "slip_outer changes nothing that is measured" not in str(found)


def test_limits_are_not_asked_about(monkeypatch: pytest.MonkeyPatch):
    """Of drives of any length: what limits are kept between the points may take long to find."""
    monkeypatch.setattr("oed.kernel.scorer.most_exceeded", None)
    assert ambiguities(posed_problem(model=DIFFERENTIAL, measurement=POSES)) == ()


@pytest.mark.slow
class TestManySamples:
    """Verdicts on drives of many samples."""

    @staticmethod
    def long(model: Model, measurement: Measurement = POSES, **parts) -> Problem:
        space = DesignSpace(duration=300, samples=2000, spline=Spline(coefficients=8))
        return posed_problem(model=model, measurement=measurement, design=space, **parts)

    @pytest.mark.parametrize(
        ("model", "measurement", "parts", "expected"),
        [
            (DIFFERENTIAL, POSES, {}, []),
            (DIFFERENTIAL, GYRO, {}, [SKID_NAMES[:3]]),
            (
                DIFFERENTIAL,
                Displacements(regressor="both", segments="samples"),
                {"criterion": E(scaling="none")},
                [],
            ),
            (DIFFERENTIAL, Several(sensors=(GYRO, RANGES)), {"estimate": C}, []),
            (SKID, POSES, {"estimate": SKID_NAMES[1:]}, []),
        ],
        ids=["poses", "gyro", "regression", "two sensors", "slip"],
    )
    def test_the_verdict(self, model, measurement, parts, expected):
        assert names_of(self.long(model, measurement, **parts)) == expected

    @pytest.mark.parametrize(("every", "told"), [(800, True), (2500, False)])
    def test_rare_readings(self, every: int, told: bool):
        # Of a drive with one position nothing is known but where it began.
        rare = Poses(quantities=("x", "y"), noise={"position": 0.01}, every=every)
        assert (names_of(self.long(DIFFERENTIAL, rare, estimate=SKID_NAMES[:2])) == []) == told


class TestWords:
    """What the message says."""

    def test_a_common_factor(self):
        (found,) = found_in(posed_problem(model=DIFFERENTIAL, measurement=GYRO))
        assert str(found) == (
            "wheel_radius_right, wheel_radius_left and track cannot be identified separately: changing "
            "wheel_radius_right by +1 %, wheel_radius_left by +1 % and track by +1 % together "
            "changes nothing that is measured"
        )
        assert dict(found.relative) == pytest.approx(dict.fromkeys(SKID_NAMES[:3], STEP), rel=1e-5)

    def test_signs_and_sizes(self):
        # A slip of -5 % that becomes -3.95 % is 21 % smaller.
        (found,) = found_in(posed_problem(model=SlipOfEachSide()))
        assert str(found) == (
            "radius, slip_right and slip_left cannot be identified separately: changing radius by +1 %, "
            "slip_right by +9 % and slip_left by -21 % together changes nothing that is measured"
        )

    def test_what_is_nominally_nothing_is_said_in_si(self):
        model = SkidSteer(wheel_radius=RADIUS, track=TRACK, slip_outer=OUTER)
        (found,) = found_in(posed_problem(model=model, criterion=E(scaling="none")))
        assert "slip_outer by +9 % and slip_inner by +0.01 (SI) together" in str(found)
        assert set(found.relative) == set(found.changes) - {"slip_inner"}

    def test_a_parameter_on_its_own(self):
        found = found_in(posed_problem(model=DIFFERENTIAL, measurement=GYRO, estimate=C))
        assert [str(one) for one in found] == [
            "c21 changes nothing that is measured",
            "c22 changes nothing that is measured",
        ]

    @pytest.mark.slow
    def test_the_refusal_names_all_of_them_and_what_to_do(self):
        problem = posed_problem(model=TwoRadii())
        with pytest.raises(ProblemError) as raised:
            require_identifiable(problem)
        (issue,) = raised.value.issues
        assert issue.key == ("measurement",)
        first, second = found_in(problem)
        assert issue.message == (
            f"{first}; {second}. Take one of them as known (leave it out of `estimate`), "
            "give a `prior`, or measure more."
        )

    @pytest.mark.parametrize(("estimate", "key"), [(None, "measurement"), (SKID_NAMES, "estimate")])
    def test_the_key_is_the_one_to_change(self, estimate, key: str):
        with pytest.raises(ProblemError) as raised:
            require_identifiable(posed_problem(model=SKID, estimate=estimate))
        assert [issue.key for issue in raised.value.issues] == [(key,)]

    @pytest.mark.slow
    def test_the_first_parameter_is_the_yardstick(self):
        for problem in (
            posed_problem(model=SKID),
            posed_problem(model=SKID, measurement=GYRO),
            posed_problem(model=TwoRadii()),
        ):
            for found in found_in(problem):
                first = next(iter(found.changes))
                assert found.relative[first] == pytest.approx(STEP, rel=1e-9)

    @pytest.mark.slow
    def test_it_is_the_same_every_time(self):
        first, again = (ambiguities(posed_anew(model=SKID)) for _ in range(2))
        assert first == again


def loops(
    twist: Callable[[np.ndarray, Sequence[float]], np.ndarray], names: Sequence[str], nominal, quantity: str
):
    """Noise-free readings of a random drive for changed parameters, by plain loops."""
    drive = random_drive(posed_problem(model=DIFFERENTIAL), 5)

    def readings(changes: Mapping[str, float]) -> np.ndarray:
        values = [value + changes.get(name, 0.0) for name, value in zip(names, nominal, strict=True)]
        twists = np.array([twist(row, values) for row in drive.inputs])
        if quantity == "yaw rates":
            return twists[:, 2]
        return oracle.roll_out(twists, START, drive.period, "arc").ravel()

    return readings


def one_radius(speeds, values):
    radius, track, right, left = values
    return oracle.differential_twist([speeds[0] * (1 - right), speeds[1] * (1 - left)], radius, radius, track)


def two_radii(speeds, values):
    *geometry, right, left = values
    return oracle.differential_twist([speeds[0] * (1 - right), speeds[1] * (1 - left)], *geometry)


def skid(speeds, values):
    *geometry, outer, inner = values
    return oracle.differential_twist(oracle.skid_speeds(speeds, outer, inner), *geometry)


def plain(speeds, values):
    return oracle.differential_twist(speeds, *values)


def by_coefficients(speeds, values):
    yaw_rate, forward = np.reshape(values, (2, 2)) @ speeds
    return np.array([forward, 0.0, yaw_rate])


SKID_NOMINAL = (RADIUS, RADIUS, TRACK, OUTER, INNER)


class TestSimulation:
    """Changing the parameters as the message says leaves the readings as they are, to second order."""

    @pytest.mark.parametrize(
        ("parts", "twist", "nominal", "quantity", "count"),
        [
            ({"model": SlipOfEachSide()}, one_radius, (RADIUS, TRACK, OUTER, INNER), "poses", 1),
            ({"model": TwoRadii()}, two_radii, SKID_NOMINAL, "poses", 2),
            ({"model": SKID}, skid, SKID_NOMINAL, "poses", 1),
            ({"model": SKID, "measurement": RANGES}, skid, SKID_NOMINAL, "poses", 1),
            (
                {"model": DIFFERENTIAL, "measurement": GYRO},
                plain,
                (RADIUS, RADIUS, TRACK),
                "yaw rates",
                1,
            ),
            (
                {"model": DIFFERENTIAL, "measurement": HEADINGS},
                plain,
                (RADIUS, RADIUS, TRACK),
                "yaw rates",
                1,
            ),
            ({"model": SKID, "measurement": GYRO}, skid, SKID_NOMINAL, "yaw rates", 2),
            ({"model": TwoRadii(), "measurement": GYRO}, two_radii, SKID_NOMINAL, "yaw rates", 3),
            (
                {"model": DIFFERENTIAL, "measurement": GYRO, "estimate": C},
                by_coefficients,
                (RADIUS / TRACK, -RADIUS / TRACK, RADIUS / 2, RADIUS / 2),
                "yaw rates",
                2,
            ),
        ],
        ids=[
            "sides",
            "radii",
            "skid",
            "skid-ranges",
            "gyro",
            "headings",
            "skid-gyro",
            "radii-gyro",
            "c-gyro",
        ],
    )
    def test_nothing_changes(self, parts: dict[str, Any], twist, nominal, quantity: str, count: int):
        problem = posed_problem(**parts)
        names = [parameter.name for parameter in problem.system.parameters]
        readings = loops(twist, names, nominal, quantity)
        found = found_in(problem)
        assert len(found) == count

        def moved(changes: Mapping[str, float]) -> float:
            return float(np.abs(readings(changes) - readings({})).max())

        for one in found:
            together = moved(one.changes)
            half = moved({name: change / 2 for name, change in one.changes.items()})
            # Halved, what is left is a quarter.
            assert half < 0.27 * together + 1e-7 * np.abs(readings({})).max()
            for name, change in one.changes.items():
                alone = moved({name: change})
                assert together < 0.05 * alone or len(one.changes) == 1
                opposite = {**one.changes, name: -change}
                assert len(one.changes) == 1 or moved(opposite) > 1.5 * alone
            for name, share in one.relative.items():
                expected = one.changes[name] / nominal[names.index(name)]
                assert share == pytest.approx(expected, rel=1e-12)


class TestPrior:
    """Knowledge from before tells what no drive does."""

    @pytest.mark.parametrize("name", ["wheel_radius_left", "slip_outer"])
    def test_of_any_parameter_of_the_combination(self, name: str):
        size = "1 mm" if "radius" in name else 0.02
        problem = posed_anew(model=SKID, prior=Prior(standard_deviations={name: size}))
        assert ambiguities(problem) == ()
        require_identifiable(problem)

    @pytest.mark.slow
    def test_of_another_parameter_does_not_help(self):
        problem = posed_anew(model=SKID, prior=Prior(standard_deviations={"track": "1 %"}))
        assert names_of(problem) == names_of(posed_problem(model=SKID))

    @pytest.mark.slow
    def test_one_for_each_combination(self):
        for known, left in (
            (("slip_right",), [("radius_left", "slip_left")]),
            (("slip_left",), [("radius_right", "slip_right")]),
            (("slip_right", "slip_left"), []),
        ):
            prior = Prior(standard_deviations=dict.fromkeys(known, 0.02))
            assert names_of(posed_anew(model=TwoRadii(), prior=prior)) == left


class Untouched(Solver):
    """A search that must not begin."""

    kind: Literal["untouched"] = "untouched"

    def search(self, problem: Problem, context: Context) -> Solution:
        raise AssertionError("the search has begun")


class TestSolve:
    """A search that could not end well does not begin."""

    @pytest.mark.parametrize("solver", [Untouched(), Ipopt(), None], ids=["any", "ipopt", "default"])
    def test_it_is_refused_before(self, solver: Solver | None):
        with pytest.raises(ProblemError, match="cannot be identified separately"):
            oed.solve(posed_problem(model=SKID), solver)

    def test_what_can_be_told_is_searched(self):
        with pytest.raises(AssertionError, match="the search has begun"):
            oed.solve(posed_problem(model=DIFFERENTIAL), Untouched())

    @pytest.mark.slow
    def test_the_solvers_own_criterion_counts(self):
        alone = E(subset=("track",))
        with pytest.raises(AssertionError, match="the search has begun"):
            oed.solve(posed_problem(model=SKID), Untouched(criterion=alone))
        with pytest.raises(ProblemError, match="cannot be identified separately"):
            oed.solve(posed_problem(model=SKID, criterion=alone), Untouched(criterion=D()))


class TestEveryRobot:
    """The rank of what poses (and a trailer's angle) tell of each listed robot."""

    @staticmethod
    def found(example: Example, measurement: Measurement) -> tuple:
        problem = problem_of(
            model=example.model,
            measurement=measurement,
            limits=input_limits(example.model),
            criterion=E(scaling="none"),
        )
        return ambiguities(problem)

    @pytest.mark.parametrize("example", ROBOTS, ids=lambda example: example.name)
    def test_rank(self, example: Example):
        trailer = "trailer_angle" in example.model.states
        sensors = [POSES, TrailerAngle(noise=0.01)] if trailer else [POSES]
        assert len(self.found(example, Several(sensors=sensors))) == example.ambiguities

    @pytest.mark.parametrize(
        "example", [one for one in ROBOTS if one.model.kind == "tractor_trailer"], ids=lambda one: one.name
    )
    def test_without_its_angle_a_trailer_is_not_told(self, example: Example):
        hidden = {name for one in self.found(example, POSES) for name in one.changes}
        assert hidden == {"hitch_offset", "trailer_length"}
