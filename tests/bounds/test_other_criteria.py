"""Bounds on D and A of robots: against drives of every sort, all drives of a grid, and designs of a study."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from places import PROBLEMS
from test_soundness import check, random_joint, random_regression
from test_speed_lattice import NOTHING, PRIOR, assert_keeps, limits, random_speeds, walks_of_all

import oed
from oed.bounds import Certificate, bound
from oed.bounds.speed_lattice import lattice_bound
from oed.kernel.criteria import A, Criterion, D
from oed.kernel.measurement.prior import Prior
from oed.robots.sensors.displacements import PoseNoise
from oed.workflow.studies import parse_study

Array = npt.NDArray[np.float64]

BOTH = (D(scaling="none"), A(scaling="none"))


def named(one: Any) -> str | None:
    return one.kind if isinstance(one, Criterion) else None


def values(kind: str, speeds: Array, weights: Array, constant: Array) -> Array:
    """The criterion of S (sum w w') S + constant for speeds (..., N, 2), by NumPy alone."""
    first, second = np.moveaxis(speeds * weights, -1, 0)
    squares = (first**2).sum(axis=-1), (second**2).sum(axis=-1)
    return values_of(kind, *squares, (first * second).sum(axis=-1), constant)


def values_of(kind: str, first: Array, second: Array, product: Array, constant: Array) -> Array:
    """The criterion of [first, product; product, second] + constant."""
    first, second, product = first + constant[0, 0], second + constant[1, 1], product + constant[0, 1]
    traces, volumes = first + second, first * second - product**2
    certain = volumes > 1e-9 * traces**2
    safe = np.where(certain, volumes, 1.0)
    # Of two parameters tr F^-1 = tr F / det F.
    return np.where(certain, np.log(safe) if kind == "D" else -traces / safe, -np.inf)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("criterion", "ends", "step", "rest", "constant", "nodes"),
    [
        (BOTH[0], (-10, 10), 2, np.inf, NOTHING, 20),
        (BOTH[1], (-3, 8), 2.5, 1.5, PRIOR, 20),
        # Where no wheel turns back, few nodes do.
        (BOTH[1], (0, 10), 20.0, np.inf, NOTHING, 8),
        (BOTH[0], (0, 10), 20.0, np.inf, PRIOR, 8),
    ],
    ids=["both ways", "prior", "one way", "one way, prior"],
)
def test_no_speeds_beat_the_lattice(
    criterion: Criterion, ends: Any, step: float, rest: float, constant: Array, nodes: int
) -> None:
    allowed, weights, rng = limits(12, ends, step, rest), np.array([0.1, 0.25]), np.random.default_rng(5)
    found = lattice_bound(allowed, weights, constant, nodes=nodes, criterion=criterion)
    assert_keeps(found.speeds, allowed)
    assert values(criterion.kind, found.speeds, weights, constant) == pytest.approx(found.lower, rel=1e-9)
    drawn = random_speeds(allowed, rng, 4000)
    assert values(criterion.kind, drawn, weights, constant).max() <= found.upper + 1e-9 * abs(found.upper)
    assert found.lower <= found.upper <= found.root + 1e-9 * abs(found.root)
    assert criterion.change(found.upper, found.lower, 2) < 0.15
    # The parts hold all speeds, also of limits that are a little wider.
    wider = limits(12, tuple(1.001 * np.array(ends)), 1.001 * step, rest * 1.001)
    more = found.bound_for(wider, weights, constant)
    assert values(criterion.kind, random_speeds(wider, rng, 1000), weights, constant).max() <= more
    assert more >= found.lower


@pytest.mark.slow
@pytest.mark.parametrize(
    ("criterion", "count", "step", "rest"), [(BOTH[1], 3, 3, np.inf), (BOTH[0], 3, 4, 2.0)]
)
def test_all_drives_of_a_finer_grid(criterion: Criterion, count: int, step: float, rest: float) -> None:
    allowed, weights = limits(count, (-3, 5), step, rest), np.array([0.3, 0.2])
    found = lattice_bound(allowed, weights, NOTHING, criterion=criterion)
    # Every walk of one wheel beside every one of the other.
    first, second = (walks * weight for walks, weight in zip(walks_of_all(allowed), weights, strict=True))
    squares = (second**2).sum(axis=1)
    best = max(
        values_of(criterion.kind, (some**2).sum(axis=1)[:, None], squares, some @ second.T, NOTHING).max()
        for some in np.array_split(first, 20)
    )
    assert best <= found.upper + 1e-9 * abs(found.upper)
    assert found.lower <= best + 1e-9 * abs(best)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "criterion"), [(0, BOTH[0]), (3, BOTH[1]), (6, BOTH[0])], ids=named)
def test_no_drive_beats_the_bound_of_a_regression(criterion: Criterion, seed: int) -> None:
    rng = np.random.default_rng(300 + seed)
    problem = random_regression(rng)
    own = criterion.model_copy(update={"scaling": problem.criterion.scaling})
    assert check(replace(problem, criterion=own), rng, 18, 12) > 20


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "criterion"), [(4, BOTH[1]), (18, BOTH[1]), (22, BOTH[0])], ids=named)
def test_no_drive_beats_the_bound_of_sensors(criterion: Criterion, seed: int) -> None:
    rng = np.random.default_rng(400 + seed)
    problem = random_joint(rng)
    own = criterion.model_copy(
        update={"scaling": problem.criterion.scaling, "subset": problem.criterion.subset}
    )
    assert check(replace(problem, criterion=own), rng, 18, 12) > 20


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "scaling", "prior"), [(D, "none", False), (A, "relative", True)])
def test_one_measurement_per_sample(kind: type[Criterion], scaling: str, prior: bool) -> None:
    known = Prior(standard_deviations={"c21": "5 %"}) if prior else None
    study = oed.load_study(PROBLEMS / "per_sample.yaml").problem
    half = study.design.model_copy(update={"samples": 30})
    problem = replace(study, criterion=kind(scaling=scaling), prior=known, design=half)
    certificate = bound(problem)
    assert certificate.drive is not None
    found = oed.evaluate(problem, certificate.drive)
    assert found.feasible
    assert 0 <= certificate.gap(found.objective, certificate.bound_on(found)) < 2e-4
    assert certificate.complete
    assert certificate.widened is not None
    assert certificate.widened.upper_bound > certificate.upper_bound
    # A bound that is easier to prove, and no better.
    assert len(certificate.bounds) == 2
    assert certificate.bounds[1].value > certificate.upper_bound


@cache
def of_segments() -> tuple[oed.Problem, Certificate]:
    """The flagship by fewer samples, and the bound on its smallest eigenvalue."""
    study = oed.load_study(PROBLEMS / "choi_skid_steer.yaml").problem
    problem = replace(study, design=study.design.model_copy(update={"samples": 40}))
    return problem, bound(problem)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [D, A])
def test_regressions_of_segments(kind: type[Criterion]) -> None:
    study, smallest = of_segments()
    certificate = bound(replace(study, criterion=kind(scaling="none")))
    # Two directions, each with what bounds it: no more than their product allows, nor less than either.
    first, *_ = smallest.bounds
    assert first.multiplier is not None
    assert np.isfinite(certificate.upper_bound)
    if kind is A:
        assert certificate.upper_bound <= -1 / first.value
    rng = np.random.default_rng(2)
    assert check(replace(study, criterion=kind(scaling="none")), rng, 15, 10) > 20


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["D", "A"])
def test_studies_have_gaps_in_efficiency(kind: str, tmp_path: Any) -> None:
    text = (PROBLEMS / "per_sample.yaml").read_text(encoding="utf-8")
    short = text.replace("kind: E, scaling: none", f"kind: {kind}").replace("samples: 100", "samples: 30")
    short = short.replace("coefficients: 30", "coefficients: 6")
    short = short.replace("starts: 12, second_stage: logdet", "starts: 1, perturbations: 0")
    record = oed.run(parse_study(short), out=tmp_path)
    certificate, best = record.certificate, record.best
    assert certificate is not None
    assert best is not None
    assert best.objective is not None
    limit = certificate.gap_to or certificate.upper_bound
    expected = np.exp((limit - best.objective) / 2) if kind == "D" else best.objective / limit
    assert certificate.gap == pytest.approx(expected - 1, abs=1e-12)
    assert 0 <= certificate.gap < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("criterion", BOTH, ids=named)
def test_blocks_add_up(criterion: Criterion) -> None:
    study = oed.load_study(PROBLEMS / "per_sample.yaml").problem
    measurement = study.measurement.model_copy(
        update={"segments": 5, "noise": PoseNoise(position=0.01, heading=0.02)}
    )
    each = [
        bound(
            replace(
                study, criterion=criterion, measurement=measurement.model_copy(update={"regressor": name})
            )
        )
        for name in ("heading", "position", "both")
    ]
    heading, position, both = (one.upper_bound for one in each)
    assert np.isfinite([heading, position]).all()
    assert both == pytest.approx(heading + position, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("criterion", BOTH, ids=named)
def test_runs_inform_as_often_as_they_are_driven(criterion: Criterion) -> None:
    study = oed.load_study(PROBLEMS / "choi_skid_steer.yaml").problem
    one, three = (
        bound(
            replace(study, criterion=criterion, design=study.design.model_copy(update={"runs": runs}))
        ).upper_bound
        for runs in (1, 3)
    )
    expected = one + 2 * np.log(3) if criterion.kind == "D" else one / 3
    assert three == pytest.approx(expected, rel=1e-7)
