"""Process noise of systems given by equations: against dense generalised least squares, and simulated."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import oed
from oed.equations.diffusion import Diffusion
from oed.equations.limits import InputRange
from oed.equations.outputs import Outputs, Rates, SeveralOutputs
from oed.equations.system import Equations
from oed.foundation.errors import PartError, ProblemError
from oed.kernel.criteria import D
from oed.kernel.dynamics.signals import PiecewiseConstant
from oed.kernel.dynamics.space import SignalSpace
from oed.kernel.evaluation import evaluate
from oed.kernel.measurement.process_noise import spread
from oed.kernel.problem import Problem
from oed.kernel.scorer import score
from oed.kernel.solution import scored
from oed.optimize.lifted import lift, lower
from oed.optimize.terms.terms import Terms
from oed.simulation.monte_carlo import validate

K, GAIN, PERIOD, SAMPLES, STEPS = 0.7, 1.3, 0.5, 12, 10
SIZES = {"fast": 0.05, "slow": 0.02}
NOISE = 0.03
STEP = 1e-30
SENSOR = Outputs(
    noise={"seen": f"{NOISE} V"},
    diffusion={"fast": "0.05 V/sqrt(s)", "slow": "0.02 V/s^(1/2)"},
    start=(("fast", np.inf), ("slow", np.inf)),
)


def problem_of(sensor: Any = SENSOR, **space: Any) -> Problem:
    """Two states, the second after the first, which saturates."""
    system = Equations(
        states={"fast": "V", "slow": "V"},
        inputs={"u": "V"},
        parameters={"k": f"{K} 1/s", "gain": GAIN, "most": "3 V"},
        derivatives={"fast": "k * (gain * u - fast - fast^2 / most)", "slow": "0.5 * k * (fast - slow)"},
        outputs={"seen": "slow", "also": "fast"},
    )
    own = {"duration": PERIOD * SAMPLES, "samples": SAMPLES, "rest_to_rest": False, **space}
    return Problem(
        model=system,
        design=SignalSpace(signals=(PiecewiseConstant(pieces=4),), start=(0.2, 0.1), **own),
        measurement=sensor,
        limits=(InputRange(input="u", range=("-1 V", "1 V")),),
        criterion=D(),
        estimate=("k", "gain"),
    )


def trial_of(problem: Problem, seed: int = 0) -> oed.Trajectory:
    each = np.random.default_rng(seed).uniform(-1, 1, (4, 1))
    return problem.design.trajectory(np.repeat(each, SAMPLES // 4, axis=0), np.array([0.2, 0.1]))


def read(problem: Problem, held: np.ndarray, unknowns: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Readings in units of their noise, by Runge and Kutta with half of each error at either end; complex."""
    k, gain, *start = unknowns
    state, seen = np.array(start), [start[1]]

    def rate(now: np.ndarray, u: float) -> np.ndarray:
        fast, slow = now
        return np.array([k * (gain * u - fast - fast**2 / 3), 0.5 * k * (fast - slow)])

    h = PERIOD / STEPS
    for u, error in zip(held, errors.reshape(-1, 2), strict=True):
        state = state + error / 2
        for _ in range(STEPS):
            one = rate(state, u)
            two = rate(state + h / 2 * one, u)
            three = rate(state + h / 2 * two, u)
            state = state + h / 6 * (one + 2 * two + 2 * three + rate(state + h * three, u))
        state = state + error / 2
        seen.append(state[1])
    return np.array(seen) / NOISE


def slopes(function: Any, at: np.ndarray) -> np.ndarray:
    return np.array([function(one).imag / STEP for one in at + 1j * STEP * np.eye(len(at))]).T


@pytest.mark.slow
def test_information_is_that_of_dense_generalised_least_squares():
    problem = problem_of()
    trial = trial_of(problem)
    held, none = trial.inputs.ravel(), np.zeros(2 * SAMPLES)
    nominal = np.array([K, GAIN, 0.2, 0.1])
    jacobian = slopes(lambda at: read(problem, held, at, none), nominal)
    effect = slopes(lambda at: read(problem, held, nominal, at), none)
    sizes = np.tile([PERIOD * size**2 for size in SIZES.values()], SAMPLES)
    covariance = np.eye(SAMPLES + 1) + effect * sizes @ effect.T
    whole = jacobian.T @ np.linalg.solve(covariance, jacobian)
    expected = whole[:2, :2] - whole[:2, 2:] @ np.linalg.solve(whole[2:, 2:], whole[2:, :2])
    found = score(problem, trial).full_square_roots["joint"].matrix
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    steady = score(problem.steady, trial).full_square_roots["joint"].matrix
    assert np.all(np.linalg.eigvalsh(steady - found) > 0)


def test_covariance_of_a_period_is_the_continuous_one_to_second_order():
    system = Equations(
        states={"x": "K"},
        parameters={"a": "2 1/s"},
        derivatives={"x": "-a * x"},
        outputs={"seen": "x"},
        substeps=50,
    )
    off = []
    for period in (0.1, 0.05):
        effect, covariance = spread(Diffusion((("x", 3.0, ""),)), system)(1.0, ca.DM(0, 1), 2.0, period)
        exact = 9.0 * (1 - np.exp(-4 * period)) / 4
        off.append(float(effect @ covariance @ effect.T) / exact - 1)
    assert abs(off[0]) < 0.01
    assert off[0] / off[1] == pytest.approx(4, rel=0.05)


@pytest.mark.slow
def test_what_is_predicted_is_what_simulated_experiments_scatter_by():
    # As small as F is for: errors of the parameters, of a few per cent, see no bends of the equations.
    wandering = (("fast", "5 mV/sqrt(s)"), ("slow", "2 mV/sqrt(s)"))
    small = SENSOR.model_copy(update={"noise": (("seen", "1 mV"),), "diffusion": wandering})
    problem = problem_of(small)
    found = validate(problem, trial_of(problem), replicates=150, seed=0)
    assert found.passed
    blind = evaluate(problem.steady, trial_of(problem)).covariances["joint"]
    assert np.all(np.diag(found.sampled) > 4 * np.diag(blind))


@pytest.mark.slow
def test_a_search_that_chooses_the_duration_sees_the_noise_of_the_time_it_takes():
    problem = problem_of(shortest=2.0)
    search = lift(problem)
    assert search is not None
    terms = Terms(search)
    z = np.random.default_rng(1).uniform(0.4, 0.9, terms.size)
    table = terms.embedding.table(z[: terms.coefficient_count] * terms.embedding.spread(terms.input_scale))
    chosen = scored(search, search.design.trajectory(table, np.array([0.2, 0.1])), "chosen")
    own = lower(problem, chosen)
    assert 2.0 < own.trajectory.duration < 6.0
    (estimation,) = problem.any_estimations
    entries = terms.at(z).entries
    scale = np.outer(estimation.scales, estimation.scales)
    expected = own.evaluation.full_square_roots["joint"].matrix * scale
    np.testing.assert_allclose(entries, expected[[0, 0, 1], [0, 1, 1]], rtol=1e-9)


class TestIssues:
    @pytest.mark.parametrize(
        ("given", "name", "said"),
        [
            ({"fats": "1 V/s^(1/2)"}, "fats", "no such state; it has fast, slow; did you mean fast"),
            ({"fast": "1 V"}, "fast", r"in V/s\^\(1/2\)"),
            ({"slow": "-1 V/sqrt(s)"}, "slow", "0 or more"),
            ({"slow": "1 V/sqrt(q)"}, "slow", "not known"),
        ],
    )
    def test_are_named_by_state_and_unit(self, given, name, said):
        with pytest.raises(ProblemError, match=said) as refused:
            problem_of(SENSOR.model_copy(update={"diffusion": tuple(given.items())}))
        assert refused.value.issues[0].key == ("measurement", "diffusion", name)

    def test_a_word_is_no_diffusion(self):
        with pytest.raises(PartError, match="diffusion: expected names, each with its value, got 'usual'"):
            type(SENSOR)(noise={"reading": "1 V"}, diffusion="usual")

    def test_readings_of_whole_periods_do_not_go_with_it(self):
        beside = Rates(noise={"also": "0.1 V"}, start=SENSOR.start)
        with pytest.raises(ProblemError, match="whole periods do not go with diffusion"):
            problem_of(SeveralOutputs(sensors=(SENSOR, beside)))


def test_no_diffusion_is_none():
    silent = SENSOR.model_copy(update={"diffusion": (("fast", "0 V/sqrt(s)"),)})
    problem = problem_of(silent)
    trial = trial_of(problem)
    blind = replace(problem, measurement=SENSOR.steady())
    assert silent.process_noise is None
    assert evaluate(problem, trial).objective == evaluate(blind, trial).objective
