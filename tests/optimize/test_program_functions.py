"""Functions of programs, put together by the chain rule, against finite differences of the program itself."""

from __future__ import annotations

import casadi as ca
import numpy as np
import oracle
import pytest
from builders import SPEED, problem_of

from oed.kernel.criteria import A, D, E, G, Leg, ModifiedE
from oed.kernel.dynamics.space import Spline
from oed.kernel.solution import Status
from oed.optimize import Ipopt, solve
from oed.optimize.terms import terms_of
from oed.optimize.transcription.design import DesignExpressions, smooth_objective
from oed.optimize.transcription.frame import Frame
from oed.optimize.transcription.functions import ProgramFunctions
from oed.robots.limits import WheelAcceleration, WheelSpeed
from oed.robots.sensors import Displacements, Poses
from oed.robots.space import DesignSpace
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import Uncertainty

SPACE = {"duration": 4, "samples": 8, "spline": Spline(coefficients=6)}
POSES = Poses(noise={"position": 0.01, "heading": 0.02})
UNCERTAIN = Uncertainty(within={"track": 0.05})

VARIANTS = {
    "E": {"criterion": E(scaling="none")},
    "D, free start": {"criterion": D(scaling="none"), "design": DesignSpace(**SPACE, start="free")},
    "A, both regressions": {
        "criterion": A(scaling="none"),
        "measurement": Displacements(segments=4, regressor="both"),
    },
    "modified E": {"criterion": ModifiedE(scaling="none")},
    "G": {
        "criterion": G(test_drive=(Leg(inputs=(3, 4), duration=2), Leg(inputs=(4, 3), duration=1))),
        "measurement": POSES,
    },
    "mean of robots": {
        "criterion": E(),
        "measurement": POSES,
        "uncertainty": UNCERTAIN,
        "robust": Robust(objective="mean"),
    },
    "worst of robots": {
        "criterion": E(),
        "measurement": POSES,
        "uncertainty": UNCERTAIN,
        "robust": Robust(objective="worst", kind="scenarios"),
    },
}


def make_functions(overrides: dict, *, bent: bool = False) -> tuple[ProgramFunctions, np.ndarray]:
    """A search's program, and a point of it."""
    design = DesignExpressions(problem_of(**{"design": DesignSpace(**SPACE), **overrides}))
    robots = [[matrix / design.scale for matrix in own] for own in design.robots]
    sought = smooth_objective(design.problem, robots)
    target = sought.maximised
    if bent:
        target = sum(2 * ca.sum1(ca.log(ca.diag(ca.chol(matrix)))) for matrix in robots[0])
    functions = ProgramFunctions(
        design,
        Frame(design.terms, relaxing=False),
        target,
        auxiliary=sought.variables,
        conditions=ca.vertcat(sought.equalities, sought.floors),
        constants=ca.SX(0, 1),
    )
    z = np.random.default_rng(1).uniform(-0.5, 0.5, design.terms.size)
    numeric = [[matrix / design.scale for matrix in own] for own in design.matrices_of(z)]
    return functions, np.concatenate([z, sought.initial(numeric)])


def check(functions: ProgramFunctions, point: np.ndarray) -> None:
    """Gradient and Jacobian are the program's slopes, the Hessian that of its Lagrangian."""
    called = functions.called
    slope = oracle.central_difference(functions.objective, point, 1e-6).ravel()
    found = np.array(called["grad_f"](point, [])[1]).ravel()
    np.testing.assert_allclose(found, slope, rtol=1e-5, atol=1e-6 * (1 + np.abs(slope).max()))
    rows, jacobian = (np.array(ca.densify(part)) for part in called["jac_g"](point, []))
    np.testing.assert_array_equal(rows, np.array(called["g"](point)))
    expected = oracle.central_difference(functions.rows, point, 1e-6)
    np.testing.assert_allclose(jacobian, expected, rtol=1e-5, atol=1e-6 * (1 + np.abs(expected).max()))
    multipliers = np.random.default_rng(2).normal(size=len(rows))

    def lagrangian_slope(x: np.ndarray) -> np.ndarray:
        through = np.array(ca.densify(called["jac_g"](x, [])[1])).T @ multipliers
        return 0.7 * functions.gradient(x) + through

    expected = oracle.central_difference(lagrangian_slope, point, 1e-5)
    upper = np.array(ca.densify(called["hess_lag"](point, [], 0.7, multipliers)))
    size = 1e-5 * (1 + np.abs(expected).max())
    np.testing.assert_allclose(upper, np.triu(expected), rtol=1e-4, atol=size)


@pytest.mark.slow
@pytest.mark.parametrize("overrides", VARIANTS.values(), ids=VARIANTS.keys())
def test_derivatives_are_finite_differences(overrides: dict):
    check(*make_functions(overrides))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["E", "A, both regressions"])
def test_so_are_those_of_an_objective_that_bends_with_the_information(name: str):
    check(*make_functions(VARIANTS[name], bent=True))


def test_a_relaxed_program_holds_every_row_twice():
    design = DesignExpressions(problem_of(design=DesignSpace(**SPACE)))
    frame = Frame(design.terms, relaxing=True)
    relaxation = ca.SX.sym("relaxation", len(design.terms.rows))
    functions = ProgramFunctions(
        design,
        frame,
        -ca.sum1(relaxation),
        auxiliary=relaxation,
        conditions=ca.SX(0, 1),
        constants=ca.SX(0, 1),
    )
    point = np.concatenate([np.random.default_rng(0).uniform(-1, 1, design.terms.size), [0.1, 0.2, 0.3]])
    check(functions, point)
    assert functions.count == 2 * sum(len(rows.lower) for rows in design.terms.rows)


def test_bounds_of_single_unknowns_are_bounds_and_tighten_with_their_limit():
    design = DesignExpressions(problem_of(design=DesignSpace(**SPACE), limits=(SPEED,)))
    (low, high), (least, _) = Frame(design.terms, relaxing=False).bounds(np.array([0.25]))
    np.testing.assert_allclose(high, np.full(design.terms.size, 0.75))
    np.testing.assert_allclose(low, -high)
    assert len(least) == 0


def test_tightening_leaves_something_of_what_several_limits_leave_of_an_unknown():
    """Speeds and accelerations of at least 0 leave the last speeds before rest nothing but 0."""
    limits = (WheelSpeed(bounds=(0, 10)), WheelAcceleration(bounds=(0, 20)))
    design = DesignExpressions(problem_of(design=DesignSpace(**SPACE), limits=limits))
    frame = Frame(design.terms, relaxing=False)
    (least, most), _ = frame.bounds(np.zeros(2))
    assert (least == most).any()
    for backoff in ((0.01, 0.01), (0.6, 0.0), (0.0, 0.6), (0.6, 0.6)):
        (low, high), _ = frame.bounds(np.array(backoff))
        assert (low <= high).all()
        assert (least <= low).all()
        assert (high <= most).all()


@pytest.mark.slow
def test_bounds_of_an_unknown_that_contradict_each_other_stay_rows():
    """From rest to rest accelerations of at least 1 ask the last speeds to be below 0."""
    limits = (WheelSpeed(bounds=(0, 10)), WheelAcceleration(bounds=(1, 20)))
    design = DesignExpressions(problem_of(design=DesignSpace(**SPACE), limits=limits))
    (low, high), (least, most) = Frame(design.terms, relaxing=False).bounds(np.zeros(2))
    assert (low <= high).all()
    assert (least <= most).all()
    assert np.isinf(low).sum() == 2
    solution = solve(design.problem, Ipopt(starts=1, perturbations=0, max_iterations=15), seed=0, workers=1)
    assert solution.status is Status.INFEASIBLE


class TestSharedTerms:
    def test_criteria_of_the_same_matrices_share_them(self):
        first = problem_of(design=DesignSpace(**SPACE), criterion=E(scaling="none"))
        second = problem_of(design=DesignSpace(**SPACE), criterion=D(scaling="none"))
        assert terms_of(first) is terms_of(second)

    @pytest.mark.parametrize(
        "other",
        [
            {"criterion": E(scaling="none", subset=("c21",))},
            {"measurement": Displacements(segments=3)},
            {"limits": (SPEED,)},
        ],
        ids=["subset", "measurement", "limits"],
    )
    def test_problems_of_other_matrices_or_limits_do_not(self, other: dict):
        plain = {"design": DesignSpace(**SPACE), "criterion": E(scaling="none")}
        assert terms_of(problem_of(**plain)) is not terms_of(problem_of(**{**plain, **other}))
