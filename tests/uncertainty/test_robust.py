"""Back-off: against paths of other robots, simulated and differentiated by NumPy alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import casadi as ca
import numpy as np
import oracle
import pytest
import sample_robots as robots
import shapely
from builders import ACCELERATION, RADIUS, SPEED, TRACK, problem_of, random_drive
from scipy.stats import norm

from oed.foundation.errors import PartError, ProblemError
from oed.kernel.criteria import A, D, E
from oed.kernel.dynamics.rollout import FINE, roll_out
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.limit import ROUNDED, PathLimit
from oed.kernel.measurement.prior import Prior
from oed.kernel.problem import Problem
from oed.robots.limits import Circle, Obstacles, Polygon, Rectangle, TrailerAngle
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import Poses
from oed.robots.space import DesignSpace, StartPose
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import spread_of

RIGHT, LEFT = "wheel_radius_right", "wheel_radius_left"
RADII = {RIGHT: "5 %", LEFT: "3 %", "track": "4 %"}
SENSOR = Poses(noise={"position": 0.01, "heading": 0.02})
PENTAGON = ((-2.0, -2.0), (2.0, -2.5), (2.6, 0.5), (0.0, 2.4), (-2.2, 1.0))
BLOCK = ((1.5, -1.5), (2.0, -1.4), (1.9, -0.9))
TRAILER = next(one for one in robots.ROBOTS if one.name == "trailer")

Distances = Callable[[np.ndarray], np.ndarray]


def space(**options: Any) -> DesignSpace:
    return DesignSpace(duration=6, samples=12, spline=Spline(coefficients=8), **options)


robust_problem = partial(
    problem_of,
    duration=6,
    samples=12,
    measurement=SENSOR,
    criterion=E(scaling="relative"),
    limits=(SPEED, ACCELERATION),
)
"""Of few samples, by absolute poses."""


def simulated(problem: Problem, drive: Trajectory, parameters: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """States (G, states) of all runs on the fine grid, without the package."""
    paths, each = [], problem.design.samples
    for run, start in enumerate(starts):
        inputs = drive.inputs[run * each : (run + 1) * each]
        twists = np.array([oracle.differential_twist(speeds, *parameters[:3]) for speeds in inputs])
        path = oracle.fine_path(twists, start, drive.period, "arc", FINE)
        if len(start) > 3:
            path = np.column_stack([path, trailed(twists, start[3], drive.period, parameters)])
        paths.append(path)
    return np.vstack(paths)


def trailed(twists: np.ndarray, angle: float, period: float, parameters: np.ndarray) -> np.ndarray:
    angles = [angle]
    for twist in twists:
        state = np.array([0.0, 0.0, 0.0, angles[-1]])
        angles += [
            TRAILER.internal(state, twist, period * part / FINE, parameters, steps=4).item()
            for part in range(1, FINE + 1)
        ]
    return np.array(angles)


ROBOT, SPACE = DifferentialDrive(wheel_radius=RADIUS, track=TRACK), space()


@dataclass(frozen=True)
class Case:
    """A problem's parts, and the distances (k, G) that one of its limits is about, by NumPy."""

    limit: Any
    distances: Distances
    within: dict[str, Any]
    model: Any = ROBOT
    design: DesignSpace = SPACE


def in_a_circle(path: np.ndarray) -> np.ndarray:
    return np.array([3.0 - np.hypot(path[:, 0] - 0.2, path[:, 1] + 0.3)])


def from_walls(path: np.ndarray) -> np.ndarray:
    corners = np.array(PENTAGON)
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.hypot(*edges.T)[:, None]
    return np.array(
        [(path[:, :2] - corner) @ normal for corner, normal in zip(corners, normals, strict=True)]
    )


def from_obstacles(path: np.ndarray) -> np.ndarray:
    column = np.hypot(path[:, 0] + 1.5, path[:, 1] - 1.5) - 0.2
    return np.array([column, shapely.distance(shapely.Polygon(BLOCK), shapely.points(path[:, :2]))])


TWO_RUNS = space(runs=2, start=(StartPose(x=0.3, y=-0.2, heading=1.0), StartPose(y=0.4)))
BOX = Rectangle(x=(-2, 2), y=(-3, 3))
AROUND = [
    {"kind": "circle", "x": -1.5, "y": 1.5, "radius": 0.2},
    {"kind": "polygon", "points": BLOCK},
]
CASES = {
    "rectangle": Case(BOX, lambda path: path[:, :2].T, RADII),
    "circle": Case(Circle(x=0.2, y=-0.3, radius=3), in_a_circle, RADII),
    "polygon": Case(Polygon(points=PENTAGON), from_walls, RADII),
    "obstacles": Case(Obstacles(shapes=AROUND), from_obstacles, RADII),
    "start": Case(BOX, lambda path: path[:, :2].T, {"track": "4 %", "x": "2 cm", "heading": "3 deg"}),
    "two_runs": Case(
        BOX, lambda path: path[:, :2].T, {RIGHT: "4 %", "y": "2 cm", "heading": "3 deg"}, design=TWO_RUNS
    ),
    "trailer": Case(
        TrailerAngle(bounds=(-1.2, 1.0)),
        lambda path: path[:, 3:].T,
        {RIGHT: "5 %", "hitch_offset": "2 cm", "trailer_length": "10 %", "heading": "2 deg"},
        TRAILER.model,
    ),
}


def made(case: Case, robust: Robust) -> tuple[Problem, Trajectory]:
    problem = robust_problem(
        robust=robust, within=case.within, also=(case.limit,), model=case.model, design=case.design
    )
    return problem, random_drive(problem, 2, 7.0)


def slopes(case: Case, problem: Problem, drive: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Distances (k, G) of the nominal robot, and their derivatives (k, G, q), by differences of paths."""
    names = [parameter.name for parameter in problem.model.parameters]
    places = {"x": 0, "y": 1, "heading": 2}
    moves = [(name, None) for name in names if name in case.within]
    moves += [(name, run) for run in range(drive.runs) for name in places if name in case.within]

    def distances(shift: np.ndarray) -> np.ndarray:
        parameters, starts = np.array(problem.model.nominal), drive.starts.copy()
        for (name, run), amount in zip(moves, shift, strict=True):
            if run is None:
                parameters[names.index(name)] += amount
            else:
                starts[run, places[name]] += amount
        return case.distances(simulated(problem, drive, parameters, starts))

    at = distances(np.zeros(len(moves)))
    found = oracle.central_difference(distances, np.zeros(len(moves)), 1e-5)
    return at, found.reshape(*at.shape, len(moves))


def widths(case: Case, problem: Problem) -> np.ndarray:
    """Half-widths of the uncertain quantities, in the order of `slopes`."""
    units = {"%": 0.01, "cm": 0.01, "deg": np.pi / 180}
    nominal = {parameter.name: parameter.nominal for parameter in problem.model.parameters}

    def size(name: str) -> float:
        number, unit = case.within[name].split()
        return float(number) * units[unit] * (nominal[name] if unit == "%" else 1.0)

    own = [size(name) for name in nominal if name in case.within]
    poses = [size(name) for name in ("x", "y", "heading") if name in case.within]
    return np.array(own + poses * problem.design.runs)


def backed_off(problem: Problem, drive: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances (k, G) of the nominal robot, and their back-off above and below."""
    rolled = roll_out(
        problem.system,
        inputs=ca.DM(drive.inputs),
        start=ca.DM(drive.starts),
        parameters=ca.DM(problem.system.nominal),
        period=ca.DM(drive.period),
        refine=FINE,
        runs=drive.runs,
    )
    (limit,) = [one for one in problem.limits if isinstance(one, PathLimit)]
    plain, rows = limit.rows(rolled), problem.limit_rows(rolled)[-1]
    values, both = np.array(plain.expression).ravel(), np.array(rows.expression).ravel()
    above, below = np.isfinite(plain.upper), np.isfinite(plain.lower)
    count = above.sum()
    np.testing.assert_array_equal(rows.upper[:count], plain.upper[above])
    np.testing.assert_array_equal(rows.lower[count:], plain.lower[below])
    high, low = np.zeros(len(values)), np.zeros(len(values))
    high[above], low[below] = both[:count] - values[above], values[below] - both[count:]
    shape = (-1, rolled.path.shape[0])
    return values.reshape(shape), high.reshape(shape), low.reshape(shape)


@cache
def compared(name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """The back-off and that of the oracle (k, G), and the limit's size."""
    case = CASES[name]
    problem, drive = made(case, Robust(beta=2.5))
    at, moves = slopes(case, problem, drive)
    sizes = widths(case, problem)
    exact = 2.5 * np.sqrt(moves**2 @ (sizes**2 / 3))
    values, high, low = backed_off(problem, drive)
    # Whatever the order of walls and obstacles; magnitudes are rounded at 0.
    order = [int(np.argmin(np.abs(at - row).max(axis=1))) for row in values]
    np.testing.assert_allclose(values, at[order], atol=1e-4)
    kept = np.maximum(high, low)
    for side in (high, low):
        assert np.allclose(side, kept) or not side.any()
    (limit,) = [one for one in problem.limits if isinstance(one, PathLimit)]
    size = limit.rows_at(ca.DM(drive.starts), problem.system).size
    return kept, exact[order], size


class TestBackOff:
    @pytest.mark.parametrize("name", CASES)
    def test_it_is_how_far_the_distance_moves(self, name: str):
        kept, exact, size = compared(name)
        assert exact.max() > 10 * ROUNDED * size
        assert np.all(kept <= exact + 1e-6)
        assert np.all(kept >= exact - ROUNDED * size - 1e-6)

    def test_it_is_in_proportion_to_the_standard_deviations(self):
        case = CASES["circle"]
        small, large = (backed_off(*made(case, Robust(beta=beta)))[2] for beta in (2.0, 4.0))
        soft = ROUNDED * 3.0
        np.testing.assert_allclose(
            (large + soft) ** 2 - soft**2, 4 * ((small + soft) ** 2 - soft**2), rtol=1e-9
        )

    def test_it_follows_the_correlations_of_a_prior(self):
        # Both radii too large together scale the path; one too large turns it.
        problem, drive = made(CASES["rectangle"], Robust(beta=2.0))
        square = (0.02 * RADIUS) ** 2
        covariance = ((square, 0.9 * square), (0.9 * square, square))
        prior = Prior(parameters=(RIGHT, LEFT), covariance=covariance)
        known = replace(problem, uncertainty=None, prior=prior)
        _, moves = slopes(replace(CASES["rectangle"], within={RIGHT: "", LEFT: ""}), known, drive)
        exact = 2.0 * np.sqrt(np.einsum("kgi,ij,kgj->kg", moves, np.array(covariance), moves))
        np.testing.assert_allclose(backed_off(known, drive)[1], exact, atol=ROUNDED * 2 + 1e-6)

    def test_nothing_is_kept_where_nothing_moves(self):
        kept, _, _ = compared("rectangle")
        np.testing.assert_allclose(kept[:, 0], 0.0, atol=1e-12)

    @pytest.mark.slow
    def test_margins_are_smaller_by_it(self):
        problem, drive = made(CASES["circle"], Robust())
        values, _, low = backed_off(problem, drive)
        margin = next(one for one in evaluate(problem, drive).margins if one.name == "workspace")
        assert margin.margin == pytest.approx((values - low).min(), abs=1e-9)

    @pytest.mark.slow
    def test_limits_on_the_inputs_are_as_they_were(self):
        problem, drive = made(CASES["rectangle"], Robust())
        tight, plain = (evaluate(one, drive).margins for one in (problem, replace(problem, robust=None)))
        moved = {one.name for one, other in zip(tight, plain, strict=True) if one != other}
        assert moved == {"workspace"}

    @pytest.mark.slow
    def test_more_uncertainty_leaves_less_room(self):
        margins = []
        for percent in (1, 3, 9):
            problem = robust_problem(robust=Robust(), within={"track": f"{percent} %"}, also=(BOX,))
            margins.append(evaluate(problem, random_drive(problem, 2, 7.0)).margins[2].margin)
        assert margins == sorted(margins, reverse=True)
        assert len(set(margins)) == 3


def other(problem: Problem, drive: Trajectory, values: np.ndarray) -> tuple[Problem, Trajectory]:
    """The problem of a robot with other values of what is uncertain, and the drive from where that begins."""
    spread = spread_of(problem.uncertain_system)
    own = dict(zip(spread.names[: spread.parameters], map(float, values), strict=False))
    starts = drive.starts + spread.shifts(values[None])[0]
    begun = replace(drive, start=starts if drive.runs > 1 else starts[0])
    plain = {"model": problem.model.with_values(own), "uncertainty": None, "robust": None}
    return replace(problem, **plain), begun


def workspace_margin(problem: Problem, drive: Trajectory) -> float:
    return next(one.margin for one in evaluate(problem, drive).margins if one.name == "workspace")


class TestScenarios:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["rectangle", "two_runs"])
    def test_limits_are_kept_by_the_robots_at_the_corners(self, name: str):
        problem, drive = made(CASES[name], Robust(kind="scenarios"))
        corners = spread_of(problem.uncertain_system).extremes(1.0)
        margins = [workspace_margin(*other(problem, drive, values)) for values in corners]
        margins.append(workspace_margin(replace(problem, robust=None), drive))
        assert workspace_margin(problem, drive) == pytest.approx(min(margins), abs=1e-9)

    @pytest.mark.parametrize("kind", ["chance", "scenarios"])
    @pytest.mark.slow
    def test_further_robots_are_kept_as_well(self, kind: str):
        far = (0.06, 0.04, 0.2)
        problem, drive = made(CASES["rectangle"], Robust(kind=kind))
        more = replace(problem, robust=Robust(kind=kind, added_scenarios=(far,)))
        expected = min(
            workspace_margin(problem, drive), workspace_margin(*other(problem, drive, np.array(far)))
        )
        assert workspace_margin(more, drive) == pytest.approx(expected, abs=1e-9)


class TestObjective:
    def objective(self, problem: Problem, drive: Trajectory, values: np.ndarray) -> float:
        found = evaluate(*other(problem, drive, values))
        (matrix,) = found.full_information.values()
        # Relative to the nominal parameters, whatever the robot's are.
        scale = np.diag([RADIUS, RADIUS, TRACK])
        eigenvalues = np.linalg.eigvalsh(scale @ matrix @ scale)
        return {
            "E": eigenvalues[0],
            "D": np.log(eigenvalues).sum(),
            "A": -np.sum(1 / eigenvalues),
        }[problem.criterion.kind]

    def problem(self, objective: str, criterion: Any, within: dict[str, str]) -> tuple[Problem, Trajectory]:
        robust = Robust(objective=objective)
        problem = robust_problem(robust=robust, within=within, criterion=criterion(scaling="relative"))
        return problem, random_drive(problem, 2, 7.0)

    @pytest.mark.slow
    @pytest.mark.parametrize("criterion", [E, D])
    def test_the_mean_is_over_robots_of_this_covariance(self, criterion):
        problem, drive = self.problem("mean", criterion, {RIGHT: "5 %", "track": "4 %"})
        sizes = np.array([0.05 * RADIUS, 0.04 * TRACK]) / np.sqrt(3)
        away = np.sqrt(2) * np.vstack([np.diag(sizes), -np.diag(sizes)])
        each = [self.objective(problem, drive, np.array([RADIUS, TRACK]) + move) for move in away]
        assert evaluate(problem, drive).objective == pytest.approx(np.mean(each), rel=1e-9)

    @pytest.mark.slow
    @pytest.mark.parametrize("criterion", [E, A])
    def test_the_worst_is_of_the_ends_and_the_nominal_robot(self, criterion):
        problem, drive = self.problem("worst", criterion, {RIGHT: "5 %", "heading": "4 deg"})
        away = np.diag([0.05 * RADIUS, np.deg2rad(4)])
        moves = np.vstack([np.zeros((1, 2)), away, -away])
        each = [self.objective(problem, drive, np.array([RADIUS, 0.0]) + move) for move in moves]
        assert evaluate(problem, drive).objective == pytest.approx(min(each), rel=1e-9)

    @pytest.mark.slow
    def test_the_nominal_one_is_that_of_the_nominal_robot(self):
        problem, drive = self.problem("nominal", E, RADII)
        assert evaluate(problem, drive).objective == evaluate(replace(problem, robust=None), drive).objective

    @pytest.mark.slow
    def test_the_worst_is_below_the_nominal_one(self):
        values = []
        for objective in ("worst", "nominal"):
            problem, drive = self.problem(objective, E, RADII)
            values.append(evaluate(problem, drive).objective)
        assert values[0] < values[1]


class TestNothingAsked:
    def test_an_uncertainty_alone_changes_nothing(self):
        problem = robust_problem(robust=None, within=RADII, also=(BOX,))
        drive = random_drive(problem, 2, 7.0)
        one, two = evaluate(problem, drive), evaluate(replace(problem, uncertainty=None), drive)
        assert (one.objective, one.margins) == (two.objective, two.margins)
        np.testing.assert_array_equal(one.path, two.path)

    def test_without_limits_on_the_path_nothing_is_backed_off(self):
        problem = robust_problem(robust=Robust(), within=RADII)
        drive = random_drive(problem, 2, 7.0)
        assert evaluate(problem, drive).margins == evaluate(replace(problem, robust=None), drive).margins


class TestOptions:
    @pytest.mark.parametrize("confidence", [0.9, 0.99, 0.997])
    def test_the_back_off_is_that_of_a_normal_distance(self, confidence: float):
        within = norm.cdf(Robust(confidence=confidence).reach) - norm.cdf(
            -Robust(confidence=confidence).reach
        )
        assert within == pytest.approx(confidence)
        assert Robust(confidence=confidence, beta=3.0).reach == 3.0

    def test_tighter_is_more_back_off(self):
        worst = np.arange(12.0).reshape(4, 3)
        careful = Robust(confidence=0.9).tighter(worst)
        assert careful.reach == pytest.approx(1.15 * Robust(confidence=0.9).reach)
        assert careful.added_scenarios == ()
        assert careful.tighter(worst).reach == pytest.approx(1.15 * careful.reach)

    def test_tighter_is_more_robots(self):
        first = Robust(kind="scenarios").tighter(np.arange(12.0).reshape(4, 3))
        second = first.tighter(10 * np.ones((1, 3)))
        assert first.added_scenarios == ((0.0, 1.0, 2.0), (3.0, 4.0, 5.0))
        assert second.added_scenarios == (*first.added_scenarios, (10.0, 10.0, 10.0))
        assert second.reach == Robust(kind="scenarios").reach

    @pytest.mark.parametrize(
        "options",
        [
            {"confidence": 0.4},
            {"confidence": 1.0},
            {"draws": 99},
            {"beta": 0.0},
            {"kind": "tube"},
            {"objective": "best"},
            {"confidance": 0.9},
        ],
    )
    def test_wrong_ones_are_refused(self, options: dict[str, Any]):
        with pytest.raises(PartError):
            Robust(**options)

    def test_a_confidence_needs_enough_draws_to_show(self):
        # If none of n draws leaves, the 95 % interval of the probability ends at 1 - 0.025^(1 / n).
        assert 1 - 0.025 ** (1 / 3688) <= 0.001 < 1 - 0.025 ** (1 / 3687)
        Robust(confidence=0.999, draws=3688)
        with pytest.raises(PartError, match="takes 3688 draws or more to show"):
            Robust(confidence=0.999, draws=3687)

    def test_it_needs_something_uncertain(self):
        with pytest.raises(ProblemError, match="robust: needs to know what is uncertain"):
            problem_of(robust=Robust())

    def test_robots_kept_have_a_value_for_everything_uncertain(self):
        with pytest.raises(ProblemError, match="expected 3 values each"):
            robust_problem(robust=Robust(added_scenarios=((0.05, 0.05),)), within=RADII)
        with pytest.raises(ProblemError, match="y, y, run 2"):
            robust_problem(robust=Robust(added_scenarios=((0.05,),)), within={"y": "1 cm"}, design=TWO_RUNS)
