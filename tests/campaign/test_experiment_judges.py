"""The judges of experiments with systems of equations: each has to see what it is there for."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import oed
from oed.workflow.studies import parse_study

from .experiments import BOUND, FEASIBLE, INFEASIBLE, SCORED, SINGULAR, WHOLE, JudgedTrial, at_most, whole
from .generator.amounts import RATE, TIME, Amount, dimension
from .generator.experiments import ExperimentStudy
from .generator.quantities import plain
from .generator.trials import draw_weights
from .oracle.equations import STEP, Equations
from .oracle.experiments import Experiment, Trial
from .oracle.signals import held

DECAY = {
    "system": {
        "kind": "equations",
        "states": {"x": 2.0},
        "inputs": {"u": ""},
        "parameters": {"k": Amount(0.7, RATE), "b": Amount(0.5, RATE)},
        "derivatives": {"x": "b * u - k * x"},
        "outputs": {"y": "x"},
    },
    "experiment": {"duration": Amount(4.0, TIME), "samples": 8, "inputs": {"u": {"range": [0.0, 1.0]}}},
    "measurement": {"kind": "outputs", "noise": {"y": 0.01}},
    "criterion": {"kind": "D", "scaling": "relative"},
}
STIFF = {
    "states": {"x": 1.0, "y": 0.5},
    "algebraic_states": {"z": 0.2},
    "algebraic": {"z": "z * (1 + z^2) - a * y"},
    "parameters": {"f": 3000.0, "a": 0.8},
    "derivatives": {"x": "f * (y - x)", "y": "-0.5 * y - 0.2 * x * z"},
    "outputs": {"seen": "x + z"},
    "integrator": "radau",
    "substeps": 20,
}
TRIAL = Trial(np.linspace(0.2, 0.9, 8)[None, :, None], np.array([[2.0]]), 4.0)


def judged(trial: Trial = TRIAL, **keys: Any) -> JudgedTrial:
    given = {"format": 1, "name": "decay", **DECAY, **keys}
    study = ExperimentStudy(plain(given), given)
    problem = parse_study(study.text(np.random.default_rng(0)), "decay.yaml").problem
    return JudgedTrial(study, problem, trial)


def failures(one: JudgedTrial, **said: Any) -> set[str]:
    """What is not so if the package said something else than it does."""
    one.__dict__["said"] = replace(one.said, **said)
    return {verdict.asked for verdict in one.verdicts() if verdict.wrong}


@pytest.mark.slow
def test_all_is_well_with_a_decay() -> None:
    limits = [{"kind": "always", "name": "low", "of": "x", "range": [0.0, 1.9]}]
    assert not failures(judged())
    assert not failures(judged(limits=limits))


def test_a_score_that_is_a_little_off_is_seen() -> None:
    one = judged()
    assert failures(one, objective=one.said.objective * (1 + 3e-6)) == {SCORED}


@pytest.mark.slow
def test_a_margin_on_the_wrong_side_is_seen() -> None:
    limits = [{"kind": "always", "name": "low", "of": "x", "range": [0.0, 1.9]}]
    one = judged(limits=limits)
    others = [replace(margin, margin=0.5) if margin.name == "low" else margin for margin in one.said.margins]
    assert failures(one, margins=tuple(others)) == {FEASIBLE}
    one = judged()
    others = [replace(margin, margin=-0.5) if margin.name == "u" else margin for margin in one.said.margins]
    assert failures(one, margins=tuple(others)) == {INFEASIBLE}


def test_a_number_for_what_is_undetermined_is_seen() -> None:
    one = judged(TRIAL, system={**DECAY["system"], "outputs": {"y": "u"}})
    assert one.said.objective == -np.inf
    assert failures(one, objective=3.0) == {SINGULAR}


def test_weights_that_are_not_whole_or_not_the_budget_are_seen() -> None:
    one = judged(weights={"readings": 3})
    rng = np.random.default_rng(0)
    weights = draw_weights(rng, one.study.spec, one.trial)
    assert not whole(one.weighted(weights)).wrong
    assert whole(one.weighted(weights * 0.5)).asked == WHOLE
    assert whole(one.weighted(weights * 0.5)).wrong
    assert whole(one.weighted(np.ones(9))).wrong


def test_what_exceeds_a_bound_is_seen() -> None:
    assert at_most("a choice", 1.0, 0.999, "E", BOUND).wrong
    assert not at_most("a choice", 1.0, 1.0, "E", BOUND).wrong


def test_the_oracle_weighs_readings_as_if_they_were_repeated() -> None:
    weights = np.zeros(9)
    weights[[2, 5]] = 2.0, 1.0
    found = Experiment(plain(DECAY), replace(TRIAL, weights=weights)).jacobian()
    every = Experiment(plain(DECAY), TRIAL).jacobian()
    np.testing.assert_allclose(found.T @ found, every[[2, 2, 5]].T @ every[[2, 2, 5]])


def test_the_oracles_runge_kutta_follows_a_decay_and_its_sensitivity() -> None:
    system = Equations({**DECAY["system"], "substeps": 100})
    p = [np.array([[0.7], [0.7 + 1j * STEP]]), np.array([[0.5], [0.5]])]
    x = system.step(np.full((1, 2, 1), 2.0 + 0j), [np.array([0.3])], p, 1.0)
    end, fade = 0.5 * 0.3 / 0.7, np.exp(-0.7)
    np.testing.assert_allclose(x[0, 0, 0].real, end + (2 - end) * fade, rtol=1e-10)
    slope = -end / 0.7 * (1 - fade) - (2 - end) * fade
    np.testing.assert_allclose(x[0, 1, 0].imag / STEP, slope, rtol=1e-9)


@pytest.mark.slow
def test_the_oracles_radau_steps_agree_with_scipy() -> None:
    system = Equations(STIFF)
    p = [np.array([[3000.0], [3000.0]]), np.array([[0.8], [0.8 + 1j * STEP]])]
    x = system.step(np.array([1.0, 0.5]).reshape(2, 1, 1) * np.ones((1, 2, 1), dtype=complex), [], p, 1.0)

    def rates(_: float, state: Any, a: float) -> Any:
        # Cardano's formula for z^3 + z = a y.
        half = a * state[1] / 2
        root = np.sqrt(half**2 + 1 / 27)
        z = np.cbrt(half + root) + np.cbrt(half - root)
        return [3000.0 * (state[1] - state[0]), -0.5 * state[1] - 0.2 * state[0] * z]

    def ends(a: float) -> Any:
        return solve_ivp(rates, (0, 1), [1.0, 0.5], "Radau", args=(a,), rtol=1e-10, atol=1e-12).y[:, -1]

    np.testing.assert_allclose(x[:, 0, 0].real, ends(0.8), rtol=1e-7)
    slope = (ends(0.8 + 1e-3) - ends(0.8 - 1e-3)) / 2e-3
    np.testing.assert_allclose(x[:, 1, 0].imag / STEP, slope, rtol=1e-4)


@pytest.mark.parametrize(
    ("signal", "unknowns", "expected"),
    [
        ({"kind": "piecewise_constant", "pieces": 2}, [1.0, 3.0], [1, 1, 3, 3]),
        ({"kind": "piecewise_linear", "pieces": 1}, [0.0, 8.0], [1, 3, 5, 7]),
        ({"kind": "spline", "degree": 1, "coefficients": 2}, [0.0, 8.0], [1, 3, 5, 7]),
        ({"kind": "fourier", "harmonics": 1}, [1.0, 0.0, 2**0.5], [2, 2, 0, 0]),
    ],
)
def test_signals_by_hand(signal: dict[str, Any], unknowns: list[float], expected: list[float]) -> None:
    np.testing.assert_allclose(held(signal, np.array(unknowns), 4.0, 4), expected, atol=1e-12)


def test_amounts_are_read_as_what_they_are() -> None:
    rng = np.random.default_rng(0)
    amount = Amount(0.37, dimension(mol=1, m=-3, s=-1))
    for _ in range(20):
        found = oed.Equations(parameters={"k": amount.text(rng)}, outputs={"y": "k"})
        assert found.parameters[0].nominal == pytest.approx(0.37, rel=1e-14)
        assert found.parameters[0].unit == amount.unit
