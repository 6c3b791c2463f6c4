"""Searches over further inputs: what they see is what comes of the experiments that they stand for."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import oed
from oed.kernel.criteria import Criterion, G, Leg
from oed.kernel.dynamics.rollout import roll_out
from oed.kernel.pace import PACE
from oed.kernel.selection import Selection
from oed.kernel.solution import scored
from oed.optimize.lifted import EffortTotal, lift, lower
from oed.optimize.terms.terms import Terms

pytestmark = pytest.mark.usefixtures("few_screened")


def decaying(measurement: oed.Rates | oed.Outputs, criterion: str | Criterion = "D") -> oed.Problem:
    """A state that decays while it is fed, for as long as is best."""
    system = oed.Equations(
        states={"a": ""},
        derivatives={"a": "u - k * a"},
        parameters={"k": "0.5 1/s"},
        inputs={"u": "1/s"},
        outputs={"a": "a"},
    )
    space = {"duration": 6, "shortest": 2.0, "samples": 12, "start": (0.2,)}
    return oed.Problem(
        model=system,
        design=oed.SignalSpace(signals=(oed.PiecewiseConstant(pieces=4),), **space),
        measurement=measurement,
        limits=[oed.InputRange(input="u", range=("0 1/s", "2 1/s"))],
        criterion=criterion,
    )


@pytest.mark.slow
@pytest.mark.parametrize("sensor", [oed.Outputs, oed.Rates])
def test_readings_say_as_much_as_in_the_time_that_is_chosen(sensor):
    problem = decaying(sensor(noise={"a": 0.1}))
    search = lift(problem)
    terms = Terms(search)
    z = np.random.default_rng(1).uniform(0.4, 0.9, terms.size)
    table = terms.embedding.table(z[: terms.coefficient_count] * terms.embedding.spread(terms.input_scale))
    own = lower(problem, scored(search, search.design.trajectory(table, np.array([0.2])), "chosen"))
    assert 2.0 < own.trajectory.duration < 6.0
    (estimation,) = problem.any_estimations
    expected = own.evaluation.full_square_roots["joint"].matrix * estimation.scales**2
    np.testing.assert_allclose(terms.at(z).entries, expected.ravel(), rtol=1e-9)


def test_what_is_predicted_has_no_further_inputs():
    """Those of the search were missed in a test drive: that was a ProblemError of keys that nobody wrote."""
    judged = G(test_drive=(Leg(inputs=(1.0,), duration=2.0),), quantity="a")
    own = decaying(oed.Outputs(noise={"a": 0.1}), judged)
    search = lift(own)
    assert search.model.input_names == ("u", "share_of_duration")
    assert search.objective.rows == own.objective.rows


@pytest.mark.slow
def test_an_earlier_design_is_no_start():
    """It has no pace, and no weights: that was an IndexError."""
    problem = decaying(oed.Outputs(noise={"a": 0.1}))
    few = {"starts": 1, "perturbations": 0, "second_stage": "none", "max_iterations": 3}
    earlier = {"first": oed.solve(problem, oed.Ipopt(**few), seed=0, workers=1)}
    with pytest.raises(oed.ProblemError, match=r"^solvers\.start_from: .* no earlier design: leave it out$"):
        oed.solve(problem, oed.Ipopt(start_from="first", **few), seed=0, workers=1, earlier=earlier)


@pytest.mark.parametrize(("sensor", "spent"), [(oed.Rates, 0.5), (oed.Outputs, 1.0)])
def test_budget_of_time_is_spent_as_fast_as_time_passes(sensor: type, spent: float):
    # Information was multiplied by the pace, what it cost was not.
    problem = replace(decaying(sensor(noise={"a": 0.1})), selection=Selection(total=2.0))
    search = lift(problem)
    (total,) = [limit for limit in search.limits if isinstance(limit, EffortTotal)]
    rows = {}
    for pace in (1.0, 0.5):
        row = [pace if name == PACE else 0.5 for name in search.model.input_names]
        inputs = ca.DM(np.tile(row, (12, 1)))
        drive = roll_out(
            search.system, inputs=inputs, start=ca.DM([0.2]), parameters=ca.DM([0.5]), period=ca.DM(0.5)
        )
        rows[pace] = float(ca.evalf(total.rows(drive).expression))
    assert rows[0.5] == pytest.approx(spent * rows[1.0])


@pytest.mark.slow
def test_a_reading_at_the_end_has_a_weight():
    """Eight readings of seven periods had eight pieces of weights: that was a ProblemError of pieces."""
    system = oed.Equations(
        states={"a": ""},
        derivatives={"a": "-k * a"},
        parameters={"k": "0.5 1/s"},
        outputs={"a": "a"},
    )
    problem = oed.Problem(
        model=system,
        design=oed.SignalSpace(duration=7, samples=7, start_bounds=((0.2, 2.0),)),
        measurement=oed.Outputs(noise={"a": 0.1}),
        limits=[],
        criterion="D",
        selection=Selection(total=1.0, pieces=8),
    )
    few = {"starts": 1, "perturbations": 0, "second_stage": "none"}
    solution = oed.solve(problem, oed.Ipopt(**few), seed=0, workers=1)
    # 0.1 / (2 t e^(-t / 2)) is the deviation of k from a reading at t, least at t = 2.
    assert solution.trajectory.start == pytest.approx((2.0,))
    assert solution.trajectory.weights == pytest.approx((0, 0, 1, 0, 0, 0, 0, 0), abs=1e-6)
