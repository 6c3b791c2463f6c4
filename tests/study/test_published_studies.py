"""Published optimal designs through their study files alone: problems/published/*.yaml."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from places import PROBLEMS

import oed
from oed.records.stored.result import Result

PUBLISHED = sorted((PROBLEMS / "published").glob("*.yaml"))
MINUTE, HOUR = 60.0, 3600.0
pytestmark = pytest.mark.usefixtures("few_screened")


MOST = 500
"""Experiments simulated here of the ten thousand of some: standard errors off by a seventh are seen."""
FIRST_START = {"kind": "ipopt", "starts": 1, "perturbations": 0, "second_stage": "none"}
# What all starts find is no worse than what the first of them does.
BY_THE_FIRST = {"solvers": [FIRST_START], "validation": {"replicates": MOST}}
FEWER = {
    "box_lucas": BY_THE_FIRST,
    "compartmental_model": BY_THE_FIRST,
    "rooney_biegler": BY_THE_FIRST,
    "lotka_volterra": {"validation": {"replicates": 100}},
    "lotka_volterra_fishing": {"solvers": [FIRST_START], "validation": {"replicates": 100}},
}
"""What takes long in a study and here is done less often, by name."""
SAMPLES = {"decay_weights": 100, "lotka_volterra": 96, "lotka_volterra_fishing": 96}
"""Of some that are sampled more finely than the digits that are printed need, by name."""


@cache
def whole(name: str) -> tuple[oed.Study, oed.Record]:
    """A study and all that is made of it."""
    study = oed.load_study(PROBLEMS / "published" / f"{name}.yaml").changed(**FEWER.get(name, {}))
    if name in SAMPLES:
        study = study.changed(experiment={**study.echo()["experiment"], "samples": SAMPLES[name]})
    return study, oed.run(study)


def best_of(record: oed.Record) -> Result:
    """What the search of a record found: no baseline."""
    best = record.best
    assert best is not None
    assert best.drive is not None
    assert best.kind == "ipopt"
    return best


def found(name: str) -> tuple[oed.Study, Result]:
    """A study and what its search finds."""
    study, record = whole(name)
    return study, best_of(record)


def found_otherwise(name: str, **changed: object) -> tuple[oed.Study, Result]:
    """A study, some of its keys changed, and what its search finds."""
    study = oed.load_study(PROBLEMS / "published" / f"{name}.yaml").changed(**changed)
    return study, best_of(oed.run(study, search_only=True))


def noise_of(study: oed.Study) -> float:
    """The standard deviation that all of a study's outputs are read with; published values are of 1."""
    sizes = {size for sensor in study.problem.sensors for size in sensor.sizes}
    assert len(sizes) == 1
    return sizes.pop()


def settings(result: Result) -> np.ndarray:
    """The points of a design of one input, ascending."""
    assert result.drive is not None
    return np.sort(result.drive.trajectory.inputs.ravel())


def taken(result: Result) -> dict[float, float]:
    """Weights above a thousandth, by time."""
    assert result.selection is not None
    return {one.time: one.weight for one in result.selection.readings if one.weight > 1e-3}


@pytest.mark.parametrize("file", PUBLISHED, ids=lambda file: file.stem)
def test_each_is_short(file):
    """Between 15 and 25 lines, with the source in the first ones."""
    lines = file.read_text().splitlines()
    assert 15 <= len(lines) <= 25
    assert lines[0].startswith("# ")


@pytest.mark.slow
def test_box_and_lucas_1959():
    """1.2295 and 6.8577 min, det F = .65677 by rates in 1/min and a noise of 1."""
    study, best = found("box_lucas")
    np.testing.assert_allclose(settings(best) / MINUTE, [1.2295, 6.8577], rtol=1e-4)
    assert math.exp(best.objective) * noise_of(study) ** 4 / MINUTE**4 == pytest.approx(0.65677, rel=1e-4)


@pytest.mark.slow
def test_atkinson_compartmental_model():
    """0.2288, 1.3886 and 18.417 h: to the digits that are printed."""
    _, best = found("compartmental_model")
    assert np.all(np.abs(settings(best) / HOUR - [0.2288, 1.3886, 18.417]) < [5e-5, 5e-5, 5e-4])


@pytest.mark.slow
def test_pukelsheim_quadratic_regression():
    """1/5, 3/5, 1/5 at -1, 0, 1; the value 1/5, which nothing exceeds by 1e-7, in less than a second."""
    study, best = found("quadratic_regression")
    noise = noise_of(study)
    grid = best.drive.trajectory.inputs.ravel()
    weights = {grid[int(time)]: weight for time, weight in taken(best).items()}
    assert list(weights) == pytest.approx([-1, 0, 1])
    assert list(weights.values()) == pytest.approx([1 / 5, 3 / 5, 1 / 5], rel=1e-6)
    assert best.objective * noise**2 == pytest.approx(1 / 5, rel=1e-6)
    certificate = oed.bound(study.problem)
    assert (certificate.upper_bound - best.objective) * noise**2 < 1e-7
    assert certificate.wall_seconds < 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("criterion", "value"),
    [("D", 6.864795 * math.log(10)), ("A", -(10**-2.236425))],
)
def test_pyomo_rooney_and_biegler(criterion: str, value: float):
    """One more reading as late as may be; log10 det F = 6.864795, log10 tr F^-1 = -2.236425."""
    judged = {"kind": criterion, "scaling": "none"}
    _, best = found_otherwise("rooney_biegler", criterion=judged, solvers=[FIRST_START])
    assert settings(best) == pytest.approx([10.0], rel=1e-5)
    assert best.objective == pytest.approx(value, rel=1e-5)


@pytest.mark.slow
def test_dynamicoed_decay():
    """Weight on [.3, .7]; .0128135."""
    study, best = found("decay_weights")
    assert list(taken(best)) == pytest.approx([0.35, 0.45, 0.55, 0.65])
    assert best.objective * noise_of(study) ** 2 == pytest.approx(0.0128135, rel=1e-4)


@pytest.mark.slow
def test_sager_lotka_volterra_without_fishing():
    """The trace .063957 of continuous weights, as samples become many."""
    study, best = found("lotka_volterra")
    assert -best.objective / noise_of(study) ** 2 == pytest.approx(0.063957, rel=1e-4)
    assert best.selection.efficiency == pytest.approx(1, abs=1e-6)


@pytest.mark.slow
def test_sager_lotka_volterra_with_fishing():
    """The trace .037000, or better, with 48 steps of fishing and of weights."""
    study, best = found("lotka_volterra_fishing")
    assert -best.objective / noise_of(study) ** 2 <= 0.037000 * (1 + 1e-4)
    for budget in best.selection.budgets:
        spent = [best.selection.readings[place] for place in budget.readings]
        assert sum(one.size * one.weight for one in spent) == pytest.approx(4.0)


@pytest.mark.slow
@pytest.mark.parametrize("file", PUBLISHED, ids=lambda file: file.stem)
def test_each_is_proved_and_its_errors_are_as_predicted(file):
    """Nothing is better, where the study asks for a proof, and estimates scatter as predicted."""
    study, record = whole(file.stem)
    assert record.validation is not None
    assert all(one.passed for one in record.validation.results)
    assert bool(record.certificate) == study.file.bound
    if record.certificate is not None:
        assert 0 <= record.certificate.gap < 1e-6


@pytest.mark.slow
def test_it_is_said_where_the_noise_is_too_large():
    """Of two readings with errors of a fifth of the largest response."""
    study, best = found("box_lucas")
    assert best.drive is not None
    loud = study.changed(measurement={"kind": "responses", "noise": {"b": 0.12}})
    validation = oed.validate(loud.problem, best.drive.trajectory, replicates=300, seed=0)
    assert not validation.passed
