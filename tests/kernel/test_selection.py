"""Chosen readings: how weights count in the score, budgets that hold, and keys that mean nothing together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from places import PROBLEMS

import oed
from oed.foundation.errors import ProblemError
from oed.kernel.reading_parts import parts_of
from oed.kernel.selection import Selection
from oed.optimize.selection import rate_trajectory, select
from oed.robots.limits import EndPosition
from oed.workflow.readings import selection_of

STOPS = oed.load_study(PROBLEMS / "laser_tracker_stops.yaml")
FEW = STOPS.changed(trajectory={**STOPS.echo()["trajectory"], "samples": 50})
"""Twenty of 51 readings, not of 201."""


def driven(problem: oed.Problem, seed: int = 0) -> oed.Trajectory:
    """A random drive that keeps to the limits on speeds."""
    space, rng = problem.design, np.random.default_rng(seed)
    table = np.zeros((space.all_coefficients, len(problem.model.inputs)))
    table[space.free_rows] = rng.uniform(-3, 3, (len(space.free_rows), table.shape[1]))
    free = np.zeros((space.runs, problem.system.chosen_states))
    return space.trajectory(
        table, problem.start_states(free) if space.start_is_free else problem.fixed_starts
    )


class TestWeights:
    def test_information_is_the_weighted_sum_of_parts(self):
        problem = STOPS.problem
        drive = driven(problem)
        parts = parts_of(problem, drive)
        weights = np.random.default_rng(1).uniform(0, 1, len(parts.readings))
        scored = oed.evaluate(problem, replace(drive, weights=weights)).objective
        assert scored == pytest.approx(float(problem.criterion.value([parts.information(weights)])), rel=1e-7)

    def test_all_of_them_are_no_weights(self):
        problem = replace(STOPS.problem, selection=None)
        drive = driven(problem)
        ones = np.ones(len(parts_of(problem, drive).readings))
        assert oed.evaluate(problem, replace(drive, weights=ones)).objective == pytest.approx(
            oed.evaluate(problem, drive).objective, rel=1e-12
        )

    @pytest.mark.slow
    def test_more_than_the_budget_is_a_violation(self):
        problem = FEW.problem
        drive = driven(problem)
        every = oed.evaluate(problem, drive)
        assert every.violations["weights"] == pytest.approx(31)
        chosen = rate_trajectory(problem, drive, "mine")
        assert "weights" not in chosen.evaluation.violations
        assert chosen.trajectory.weights.sum() == 20
        # Whoever asks again, as every saved record does, waits no more; weights are of no matter.
        assert select(problem, drive) is select(problem, chosen.trajectory)
        assert select(replace(problem), drive) is not select(problem, drive)

    @pytest.mark.parametrize("weights", [np.ones(3), np.ones((201, 1)), -np.ones(201)])
    def test_others_are_refused(self, weights: np.ndarray):
        drive = driven(STOPS.problem)
        with pytest.raises(ValueError, match="expected weights of"):
            oed.evaluate(STOPS.problem, replace(drive, weights=weights))


class TestKeys:
    @pytest.mark.parametrize(
        ("keys", "said"),
        [
            ({}, "expected either total"),
            ({"total": 1, "readings": 1}, "expected either total"),
            ({"readings": 300}, "at most 201"),
            ({"total": {"pose": 3}}, "expected one of each of poses, got pose"),
            ({"readings": 5, "pieces": 7}, "a divisor of the 201 readings"),
            ({"readings": 5, "most": 1.5}, "whole times"),
            ({"readings": 5, "of": "trials", "pieces": 3}, "pieces are parts of trials"),
        ],
    )
    def test_mistakes_name_what_is_wrong(self, keys: dict[str, object], said: str):
        with pytest.raises((ProblemError, ValueError), match=said):
            replace(STOPS.problem, selection=Selection(**keys))

    def test_seconds_are_of_what_is_read_all_the_time(self):
        assert Selection(total="2 min").total == 120.0
        assert Selection(total={"rates": "1 h"}).total == {"rates": 3600.0}

    def test_criteria_that_are_not_concave_are_refused(self):
        with pytest.raises(ProblemError, match="weights: need a concave criterion, which modified_E is not"):
            replace(STOPS.problem, criterion=oed.ModifiedE(), selection=Selection(readings=5))

    def test_regressions_have_no_readings_to_choose(self):
        problem = oed.load_study(PROBLEMS / "choi_skid_steer.yaml").problem
        with pytest.raises(ProblemError, match="weights: weights need sensors"):
            replace(problem, selection=Selection(readings=5))


@pytest.mark.slow
def test_of_three_drives_each_is_repeated_as_often_as_is_best():
    """Ten drives of three kinds: the split by exchange is that of all splits."""
    study = oed.load_study(PROBLEMS / "three_runs.yaml")
    problem = replace(study.problem, selection=Selection(readings=10, most=10, of="trials"))
    drive = driven(study.problem)
    found = select(problem, drive)
    counts = found.chosen.values.astype(int)
    assert counts.sum() == 10
    # Parts of drives could be shared out better still.
    assert found.relaxed.value > found.chosen.value
    values = {
        (one, other): float(
            problem.criterion.value([found.parts.information(np.array([one, other, 10.0 - one - other]))])
        )
        for one in range(11)
        for other in range(11 - one)
    }
    assert max(values, key=values.__getitem__) == tuple(counts[:2])


@pytest.mark.slow
def test_what_is_not_read_is_not_simulated_either():
    """The predicted covariance is that of the twenty readings, and their estimates scatter so."""
    problem = FEW.problem
    chosen = rate_trajectory(problem, driven(problem), "mine")
    validation = oed.validate(problem, chosen.trajectory, replicates=100, seed=0)
    np.testing.assert_allclose(
        np.sqrt(np.diag(validation.predicted)),
        list(chosen.evaluation.standard_deviations.values()),
        rtol=1e-9,
    )
    assert validation.passed


UNDETERMINED = """
format: 1
name: Two ways out
system:
  kind: equations
  states: {x: 2}
  parameters: {out: 0.3 1/s, lost: 0.2 1/s, fed: 0.1 1/s}
  derivatives: {x: fed - out * x - lost * x}
  outputs: {y: x}
experiment: {duration: 8 s, samples: 30}
measurement: {kind: outputs, noise: {y: 0.01}}
criterion: {kind: A, subset: [out]}
weights: {readings: 20}
"""
"""Only the sum of both ways out can be known: what is left of one is rounding."""


@pytest.mark.slow
def test_of_a_search_that_finds_no_drive_no_readings_are_chosen():
    # Of four random drives none ends within a micrometre of a corner.
    corner = EndPosition(at={"x": 1.0, "y": 1.0}, tolerance=1e-6)
    problem = replace(FEW.problem, limits=(*FEW.problem.limits, corner))
    found = oed.solve(problem, oed.Genetic(population=4, generations=1), workers=1)
    assert found.status is oed.Status.FAILED
    assert (found.trajectory, found.evaluation) == (None, None)


def test_no_choice_is_best_of_readings_that_leave_parameters_undetermined():
    problem = oed.parse_study(UNDETERMINED, "two_ways.yaml").problem
    assert select(problem, problem.design.only) is None
    chosen = rate_trajectory(problem, problem.design.only, "mine")
    assert chosen.trajectory.weights == pytest.approx(np.full(31, 20 / 31))
    assert chosen.evaluation.objective == -np.inf
    assert oed.bound(problem).upper_bound == np.inf
    assert selection_of(problem, chosen) is None


@pytest.mark.slow
@pytest.mark.parametrize("readings", [1, 2])
def test_fewer_readings_than_parameters_leave_them_undetermined(readings: int):
    text = UNDETERMINED.replace("subset: [out]", "subset: [out, fed]").replace("samples: 30", "samples: 12")
    text = text.replace("readings: 20", f"readings: {readings}")
    problem = oed.parse_study(
        f"{text}estimate: [out, lost, fed]\nprior: {{standard_deviations: {{lost: 0.1 1/s}}}}\n", "few.yaml"
    ).problem
    found = select(problem, problem.design.only)
    taken = found.chosen.values
    assert taken.sum() == readings
    known = oed.evaluate(problem, replace(problem.design.only, weights=taken)).objective
    assert found.chosen.value == pytest.approx(known, rel=1e-9)


PARABOLA = """
format: 1
name: Five points of a parabola
system:
  kind: equations
  inputs: {x: ""}
  parameters: {a: 1, b: 1, c: 1}
  outputs: {y: a + b * x + c * x^2}
experiment:
  candidates: {grid: {x: [-1, -0.5, 0, 0.5, 1]}}
measurement: {kind: responses, noise: {y: 1}}
weights: {readings: 3}
criterion: {kind: D, scaling: none}
"""
"""Three are best read, once each."""


@pytest.mark.slow
def test_weights_that_need_not_be_whole_are_no_worse_where_their_search_ends_early(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr("oed.optimize.interior_point.MOST_STEPS", 0)
    problem = oed.parse_study(PARABOLA, "parabola.yaml").problem
    found = select(problem, problem.design.only)
    even = np.full(5, 3 / 5)
    assert found.chosen.value > float(problem.criterion.value([found.parts.information(even)]))
    assert found.relaxed.value >= found.chosen.value
    known = problem.criterion.judge([found.parts.root(found.relaxed.values)])
    assert found.relaxed.value == pytest.approx(float(known), rel=1e-9)
