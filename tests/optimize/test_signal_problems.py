"""Problems whose inputs are signals of several kinds, and whose starts are chosen within bounds."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

import oed
from oed.kernel.criteria import D
from oed.kernel.dynamics.signals import (
    Constant,
    Fourier,
    PiecewiseConstant,
    PiecewiseLinear,
    Signal,
    SplineSignal,
)
from oed.optimize.terms.layout import divisible
from oed.optimize.terms.pieces import Pieces
from oed.optimize.terms.unrolled import Unrolled
from oed.optimize.transcription.chain import Frame
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.starting_points import perturbed, random_drives, start_bounds

STEPS = (PiecewiseConstant(pieces=5), Constant(), Fourier(harmonics=2))
SMOOTH = (PiecewiseLinear(pieces=3), Constant(shared=True), SplineSignal(degree=2, coefficients=6))
MIXED = [STEPS, SMOOTH]
RANGES = {"u": (0.5, 2.0), "v": (0.1, 1.0), "w": ("0 1/s", "0.5 1/s")}


def problem_of(signals: tuple[Signal, ...] = STEPS, samples: int = 24, **parts: Any) -> oed.Problem:
    """Two reactions whose rates two inputs multiply, fed by a third; two runs, one state chosen."""
    system = oed.Equations(
        states={"a": "", "b": ""},
        derivatives={"a": "w - k1 * u * a", "b": "k1 * u * a - k2 * b * v"},
        parameters={"k1": "0.7 1/s", "k2": "0.4 1/s"},
        inputs={"u": "", "v": "", "w": "1/s"},
        outputs={"a": "a", "b": "b"},
        substeps=2,
    )
    space: dict[str, Any] = {"duration": 4.0, "samples": samples, "runs": 2, "signals": signals}
    return oed.Problem(
        model=system,
        design=oed.SignalSpace(**{**space, "start_bounds": ((0.2, 1.0), (0.1, 0.1)), **parts}),
        measurement=oed.Outputs(noise={"a": 0.1, "b": 0.1}),
        limits=[oed.InputRange(input=name, range=pair) for name, pair in RANGES.items()],
        criterion=D(scaling="none"),
    )


def in_pieces(problem: oed.Problem) -> Pieces:
    layout = divisible(problem)
    assert layout is not None
    return Pieces(problem, layout)


def weights_of(terms: Pieces) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    return rng.normal(size=terms.entry_count), rng.normal(size=sum(len(one.lower) for one in terms.rows))


def dense(matrix: ca.DM) -> np.ndarray:
    return np.array(ca.DM(matrix))


@pytest.mark.parametrize("signals", MIXED, ids=["steps", "smooth"])
class TestTermsOfSignals:
    def test_pieces_are_the_whole_drive(self, signals: tuple[Signal, ...]):
        problem = problem_of(signals)
        pieces, whole = in_pieces(problem), Unrolled(problem)
        assert pieces.linear == whole.linear == [True] * 3
        for one, other in zip(pieces.rows, whole.rows, strict=True):
            np.testing.assert_array_equal(one.lower, other.lower)
            np.testing.assert_array_equal(one.upper, other.upper)
        z = np.random.default_rng(1).uniform(0.1, 1.0, pieces.size)
        for name in ("values", "jacobian"):
            for one, other in zip(getattr(pieces, name)(z), getattr(whole, name)(z), strict=True):
                np.testing.assert_allclose(dense(one), dense(other), rtol=1e-9, atol=1e-11)
        found, expected = (one.hessian(z, *weights_of(pieces)) for one in (pieces, whole))
        np.testing.assert_allclose(dense(found), dense(expected), rtol=1e-8, atol=1e-10)

    def test_derivatives_are_those_of_differences(self, signals: tuple[Signal, ...]):
        terms = in_pieces(problem_of(signals))
        z = np.random.default_rng(1).uniform(0.1, 1.0, terms.size)
        entries, rows = weights_of(terms)

        def gradient(at: np.ndarray) -> np.ndarray:
            by_entries, by_rows = map(dense, terms.jacobian(at))
            return by_entries.T @ entries + by_rows.T @ rows

        def weighted(at: np.ndarray) -> float:
            own, stacked = map(dense, terms.values(at))
            return float(own.ravel() @ entries + stacked.ravel() @ rows)

        steps = 1e-5 * np.eye(terms.size)
        slopes = [(weighted(z + step) - weighted(z - step)) / 2e-5 for step in steps]
        np.testing.assert_allclose(gradient(z), slopes, rtol=1e-6, atol=1e-5)
        bent = [(gradient(z + step) - gradient(z - step)) / 2e-5 for step in steps]
        curvature = dense(ca.triu2symm(terms.hessian(z, entries, rows)))
        np.testing.assert_allclose(curvature, np.array(bent), rtol=1e-6, atol=1e-4)

    def test_are_those_of_the_drive_as_scored(self, signals: tuple[Signal, ...]):
        problem = problem_of(signals)
        design = DesignExpressions(problem)
        (z,) = random_drives(design, np.array([0.7]), np.random.default_rng(0))
        drive = design.trajectory(z)
        ((matrix,),) = design.matrices_of(z)
        (scored,) = oed.evaluate(problem, drive).information.values()
        np.testing.assert_allclose(matrix, scored, rtol=1e-8)
        np.testing.assert_allclose(design.unknowns_of(drive), z, atol=1e-12)

    def test_random_drives_keep_the_ranges(self, signals: tuple[Signal, ...]):
        problem = problem_of(signals)
        design = DesignExpressions(problem)
        rng = np.random.default_rng(0)
        drawn = random_drives(design, np.ones(50), rng)
        drawn = np.vstack([drawn, [perturbed(design, one, rng) for one in drawn]])
        first = design.terms.coefficient_count
        assert np.abs(drawn[:, first:]).max() <= 1
        for z in drawn[:50]:
            low, high = problem.input_bounds.T
            held = design.trajectory(z).inputs
            assert np.all((held >= low - 1e-12) & (held <= high + 1e-12))


def test_rows_that_repeat_are_bounds_of_one_unknown():
    terms = in_pieces(problem_of())
    # Of two runs: five values each, a constant each, and what a wave is at 24 times.
    assert [len(one.lower) for one in terms.rows] == [10, 2, 48]
    rows, unknowns, _, _ = terms.bounded_unknowns
    np.testing.assert_array_equal(rows, np.arange(12))
    np.testing.assert_array_equal(unknowns, np.arange(12))
    (low, high), (least, _) = Frame(terms, relaxing=False).bounds(np.zeros(3))
    np.testing.assert_allclose(low[:12], [*[0.25] * 10, 0.1, 0.1])
    np.testing.assert_allclose(high[:12], 1.0)
    assert len(least) == 48


def test_chosen_starts_are_bounds_of_unknowns():
    problem = problem_of()
    design = DesignExpressions(problem)
    assert design.terms.size == design.terms.coefficient_count + 2
    (low, high), _ = Frame(design.terms, relaxing=False).bounds(np.zeros(3))
    np.testing.assert_array_equal(low[-2:], [-1.0, -1.0])
    np.testing.assert_array_equal(high[-2:], [1.0, 1.0])
    np.testing.assert_array_equal(start_bounds(design), [[-1.0, 1.0]] * 2)


@pytest.mark.parametrize("signals", MIXED, ids=["steps", "smooth"])
def test_solved_by_ipopt_and_by_the_genetic_algorithm(signals: tuple[Signal, ...]):
    problem = problem_of(signals)
    ipopt = oed.Ipopt(starts=3, perturbations=0, second_stage="none")
    best = oed.solve(problem, ipopt, seed=0, workers=1)
    assert best.status is oed.Status.CONVERGED
    genetic = oed.Genetic(population=60, generations=60)
    near = oed.solve(problem, genetic, seed=0, workers=1)
    for found in (best, near):
        assert found.evaluation.feasible
        starts = found.trajectory.starts
        assert np.all((starts[:, 0] >= 0.2) & (starts[:, 0] <= 1.0))
        np.testing.assert_array_equal(starts[:, 1], 0.1)
        # What was found is of the space.
        DesignExpressions(problem).unknowns_of(found.trajectory)
    assert near.evaluation.objective < best.evaluation.objective < near.evaluation.objective + 0.5
