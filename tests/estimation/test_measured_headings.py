"""Replicates with measured headings, all at once, against a plain loop over them on the same noise."""

from __future__ import annotations

import math
import tracemalloc
from itertools import pairwise, product

import numpy as np
import pytest
from builders import SPEED, problem_of, random_drive

from oed.estimation.methods import EstimatorName, Regression
from oed.estimation.methods.measured_headings import MeasuredHeadings, corrected_covariance, cosine_and_sine
from oed.robots.sensors import Displacements
from oed.simulation import validate

POSITION, HEADING = 0.1, math.radians(10)
METHODS: tuple[EstimatorName, ...] = ("ols", "sandwich", "gls", "errors_in_variables")


def make(segments: int | str, noise_model: str = "increments", samples: int = 40, runs: int = 1):
    problem = problem_of(
        duration=samples / 4 * runs,
        samples=samples * runs,
        runs=runs,
        measurement=Displacements(
            segments=segments,
            regressor="position",
            noise={"position": POSITION, "heading": HEADING},
            noise_model=noise_model,
        ),
        limits=(SPEED,),
    )
    return problem, random_drive(problem, 3, 5.0)


def drawn(regression: Regression, count: int, runs: int, *, absolute: bool) -> tuple[np.ndarray, np.ndarray]:
    """Errors of displacements (R, 2 P) and of headings (R, N), from the numbers that a simulation draws."""
    rng = np.random.default_rng(5)
    segments, samples = len(regression.regressors.edges) - 1, regression.regressors.trajectory.samples
    if absolute:
        poses = rng.standard_normal((count, runs, segments // runs + 1, 2))
        moves = np.diff(poses, axis=2).reshape(count, -1)
    else:
        moves = rng.standard_normal((count, 2 * segments))
    return POSITION * moves, HEADING * rng.standard_normal((count, samples))


def estimated_alone(regression: Regression, move: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """One replicate's estimates: W~ sample by sample, then NumPy's least squares."""
    found, edges = regression.regressors, regression.regressors.edges
    turned = []
    for (along, across), error in zip(found.per_sample, errors, strict=True):
        cosine, sine = math.cos(error), math.sin(error)
        turned.append([cosine * along - sine * across, sine * along + cosine * across])
    design = np.vstack([np.sum(turned[first:last], axis=0) for first, last in pairwise(edges)])
    measured = found.nominal_designs["position"] @ found.true["position"] + move
    if regression.name == "errors_in_variables":
        shrink, own = math.exp(-(HEADING**2) / 2), found.per_sample.reshape(-1, design.shape[1])
        normal = design.T @ design / shrink**2 - (shrink**-2 - 1) * own.T @ own
        return np.linalg.solve(normal, design.T @ measured / shrink)
    if regression.name == "gls" and regression.measurement.noise_model == "absolute":
        runs = regression.regressors.trajectory.runs
        count = len(design) // 2 // runs
        steps = np.diff(np.eye(count + 1), axis=0)
        shape = np.kron(np.eye(runs), np.kron(steps @ steps.T, np.eye(2)))
        root = np.linalg.cholesky(shape)
        design, measured = np.linalg.solve(root, design), np.linalg.solve(root, measured)
    return np.linalg.lstsq(design, measured, rcond=None)[0]


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize(
    ("segments", "noise_model", "runs"),
    [(10, "increments", 1), (7, "absolute", 1), ("samples", "increments", 1), (6, "absolute", 2)],
    ids=["even", "uneven", "samples", "runs"],
)
def test_every_replicate_is_numpys_least_squares(
    monkeypatch: pytest.MonkeyPatch, name: EstimatorName, segments, noise_model: str, runs: int
):
    # In blocks of four replicates and a rest.
    monkeypatch.setattr("oed.estimation.methods.measured_headings.BLOCK", 4 * 40 * runs + 1)
    problem, drive = make(segments, noise_model, runs=runs)
    regression = Regression(problem, drive, name, "measured")
    moves, errors = drawn(regression, 15, runs, absolute=noise_model == "absolute")
    expected = np.array([estimated_alone(regression, *one) for one in zip(moves, errors, strict=True)])
    found, _ = regression.simulate(np.random.default_rng(5), 15)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=0)
    assert np.abs(found / regression.true - 1).max() > 0.01


@pytest.mark.parametrize("edges", [[0, 3], [0, 2, 3], [0, 1, 2, 3]], ids=["one", "two", "samples"])
def test_the_corrected_covariance_is_that_of_the_equation_of_all_headings(edges: list[int]):
    # By quadrature over all errors of three headings, however large.
    real, imaginary = np.random.default_rng(4).standard_normal((2, 3, 2))
    rows, true, noise, variance = real + 1j * imaginary, np.array([1.0, 0.7]), 0.4, POSITION**2
    shrink, begins = math.exp(-(noise**2) / 2), edges[:-1]
    nodes, weights = np.polynomial.hermite_e.hermegauss(20)
    errors = noise * np.array(list(product(nodes, repeat=3)))
    likely = np.prod(list(product(weights / weights.sum(), repeat=3)), axis=1)
    plain, own = np.add.reduceat(rows, begins), (rows.conj().T @ rows).real
    designs = np.add.reduceat(np.exp(1j * errors)[..., None] * rows, begins, axis=1)
    normal = np.einsum("hpa,hpb->hab", designs.conj(), designs).real
    right = np.einsum("hpa,p->ha", designs.conj(), plain @ true).real
    off = right / shrink - (normal / shrink**2 - (shrink**-2 - 1) * own) @ true
    np.testing.assert_allclose(likely @ off, 0, atol=1e-12)
    scatter = np.einsum("h,ha,hb->ab", likely, off, off)
    scatter += variance / shrink**2 * np.einsum("h,hab->ab", likely, normal)
    undisturbed = (plain.conj().T @ plain).real
    inverse = np.linalg.inv(undisturbed)
    found = corrected_covariance(
        rows,
        np.array(edges),
        true,
        heading_noise=noise,
        spread=variance * undisturbed,
        variance=variance,
    )
    np.testing.assert_allclose(found, inverse @ scatter @ inverse, rtol=1e-10, atol=0)


def test_blocks_follow_each_other(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("oed.estimation.methods.measured_headings.BLOCK", 7)
    headings = MeasuredHeadings(np.ones((2, 2, 2)), np.array([0, 2]))
    assert [(own.start, own.stop) for own in headings.blocks(8)] == [(0, 3), (3, 6), (6, 8)]
    monkeypatch.setattr("oed.estimation.methods.measured_headings.BLOCK", 1)
    assert len(list(headings.blocks(3))) == 3


def test_cosine_and_sine():
    angles = np.concatenate(
        [np.linspace(-10, 10, 20001), np.pi * np.arange(-4, 5) / 2, 10.0 ** np.arange(-300, 1)]
    )
    cosine, sine = cosine_and_sine(angles)
    np.testing.assert_allclose(cosine, np.cos(angles), rtol=0, atol=1e-15)
    np.testing.assert_allclose(sine, np.sin(angles), rtol=0, atol=1e-15)
    small = np.abs(angles) < 0.1
    np.testing.assert_allclose(sine[small], np.sin(angles[small]), rtol=1e-15, atol=1e-300)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_replicates(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("oed.simulation.checks.KEPT", 1000)
    problem, drive = make(10, samples=200)

    def peak(replicates: int) -> int:
        tracemalloc.start()
        try:
            validate(problem, drive, heading="measured", replicates=replicates)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(10)  # What the first call loads is not the replicates'.
    few, many = peak(3000), peak(12_000)
    assert many < few + 100_000
    assert many < 20e6
