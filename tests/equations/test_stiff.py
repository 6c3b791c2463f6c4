"""Radau's steps of stiff and differential-algebraic systems against SciPy's, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from stiff_systems import CONSERVED, CSTR, ROBERTSON, cstr, reference, robertson, system

import oed
from oed.equations.system import Equations
from oed.foundation.errors import NotFinite, ProblemError, UserMistake
from oed.kernel.dynamics.system import carrier, signaller, stepper
from oed.kernel.scorer import score

EVERY = np.concatenate([[0.0], np.geomspace(1e-5, 40.0, 48)])
"""Times [s] that Robertson's fast begin needs."""


def followed(
    own: Equations, start: list[float], inputs: list[float], times: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The state at the last of some times and its derivatives by (parameters, start)."""
    step, carry, size = stepper(own), carrier(own), len(start)
    state, slopes = ca.DM(start), ca.horzcat(ca.DM(size, len(own.parameters)), ca.DM.eye(size))
    for length in np.diff(times):
        slopes = carry(slopes, state, inputs, own.nominal, length)
        state = step(state, inputs, own.nominal, length)
    return np.array(state).ravel(), np.array(slopes)


class TestAgainstReference:
    @pytest.mark.slow
    def test_robertson(self):
        own = system(ROBERTSON)
        states, slopes = followed(own, [1.0, 0.0, 0.0], [], EVERY)
        exact, exact_slopes = reference(robertson, [1.0, 0.0, 0.0], [], own.nominal, EVERY[-1])
        np.testing.assert_allclose(states, exact, rtol=1e-8)
        np.testing.assert_allclose(slopes, exact_slopes, rtol=1e-7)

    @pytest.mark.slow
    def test_robertson_with_its_conservation_as_an_equation(self):
        own = system(CONSERVED)
        states, slopes = followed(own, [1.0, 0.0], [], EVERY)
        exact, exact_slopes = reference(robertson, [1.0, 0.0, 0.0], [], own.nominal, EVERY[-1])
        np.testing.assert_allclose(states, exact[:2], rtol=1e-8)
        np.testing.assert_allclose(slopes[:, :3], exact_slopes[:2, :3], rtol=1e-7)
        rest = signaller(own)(states, [], own.nominal, 0.0)
        assert float(rest) == pytest.approx(exact[2], rel=1e-8)

    @pytest.mark.slow
    def test_a_stirred_tank(self):
        own = system(CSTR, substeps=16)
        states, slopes = followed(own, [500.0, 350.0], [345.0], np.array([0.0, 30.0]))
        exact, exact_slopes = reference(cstr, [500.0, 350.0], [345.0], own.nominal, 30.0)
        np.testing.assert_allclose(states, exact, rtol=1e-8)
        np.testing.assert_allclose(slopes, exact_slopes, rtol=1e-7)


class TestSteps:
    @pytest.mark.slow
    @pytest.mark.parametrize("of", ["states", "slopes"])
    def test_are_of_fifth_order(self, of: str):
        exact = reference(cstr, [500.0, 350.0], [345.0], system(CSTR).nominal, 30.0)
        off = []
        for substeps in (4, 8):
            found = followed(system(CSTR, substeps=substeps), [500.0, 350.0], [345.0], np.array([0.0, 30.0]))
            place = ("states", "slopes").index(of)
            off.append(np.abs(found[place] / exact[place] - 1).max())
        assert 4.7 < np.log2(off[0] / off[1]) < 5.3

    @pytest.mark.parametrize("keys", [ROBERTSON, CONSERVED, CSTR])
    def test_of_no_time_change_nothing(self, keys: dict[str, Any]):
        own = system(keys)
        state = np.array([0.9, 2e-5, 0.1, 0])[: len(own.states)]
        found = stepper(own)(state, 300.0 * np.ones(len(own.inputs)), own.nominal, 0.0)
        np.testing.assert_allclose(np.array(found).ravel(), state, rtol=1e-14)

    @pytest.mark.parametrize("length", np.geomspace(1e-6, 1e3, 10))
    def test_of_any_length_are_solved(self, length: float):
        """From where Robertson's fast reaction is far from its balance; nothing is lost on the way."""
        own = system(ROBERTSON, substeps=1)
        (a, b, c), _ = followed(own, [1.0, 0.0, 0.0], [], np.array([0.0, length]))
        assert a + b + c == pytest.approx(1.0, abs=1e-12)
        assert a < 1.0
        assert b > 0.0

    def test_single_state_takes_several_substeps(self):
        keys: dict[str, Any] = {
            "states": {"x": ""},
            "derivatives": {"x": "-k * x"},
            "parameters": {"k": "2 1/s"},
            "outputs": {"y": "x"},
            "integrator": "radau",
        }
        end = stepper(system(keys, substeps=8))([3.0], [], [2.0], 0.5)
        assert float(end) == pytest.approx(3.0 * np.exp(-1.0), rel=1e-7)

    def test_damp_what_is_infinitely_stiff(self):
        """Stability at infinity: one step of a rate of 1e12 leads to where it wants to be."""
        own = Equations(
            states={"x": ""},
            derivatives={"x": "k * (1 - x)"},
            parameters={"k": "1e12 1/s"},
            outputs={"y": "x"},
            integrator="radau",
            substeps=1,
        )
        assert float(stepper(own)([5.0], [], own.nominal, 1.0)) == pytest.approx(1.0, abs=1e-10)


def sized(own: Equations) -> tuple[ca.Function, np.ndarray]:
    """The step as a function of everything in units of about its size, and where that is 1."""
    sizes = np.concatenate([[0.95, 3e-5, 0.05][: len(own.states)], own.nominal, [0.5]])
    if own.inputs:
        sizes = np.concatenate([[520.0, 352.0], [345.0], own.nominal, [5.0]])
    whole = ca.SX.sym("whole", len(sizes))
    split = np.cumsum([0, len(own.states), len(own.inputs), len(own.parameters), 1])
    given = [(whole * sizes)[first:last] for first, last in pairwise(split)]
    return ca.Function("sized", [whole], [stepper(own)(*given) / sizes[: len(own.states)]]), np.ones(
        len(sizes)
    )


def differences(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, change: float) -> np.ndarray:
    """Derivatives by central differences of fourth order, the last axis by what."""
    columns = []
    for one in np.eye(len(at)) * change:
        ends = {share: function(at + share * one) for share in (-2, -1, 1, 2)}
        columns.append((8 * (ends[1] - ends[-1]) - (ends[2] - ends[-2])) / (12 * change))
    return np.stack(columns, axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("keys", [CONSERVED, CSTR], ids=["algebraic", "input"])
def test_three_derivatives_of_a_step_are_those_of_its_values(keys: dict[str, Any]):
    step, at = sized(system(keys, substeps=1))
    symbol, size = ca.SX.sym("at", len(at)), len(at)
    expressions = [step(symbol)]
    for _ in range(3):
        expressions.append(ca.jacobian(ca.vec(ca.densify(expressions[-1])), symbol))
    functions = [ca.Function("derivative", [symbol], [ca.densify(one)]) for one in expressions]
    for lower, higher in pairwise(functions):
        found = np.array(higher(at))
        numeric = differences(lambda there, own=lower: np.array(own(there)).ravel(order="F"), at, 2e-4)
        assert found.shape[1] == size
        assert np.abs(found).max() > 0
        np.testing.assert_allclose(found, numeric, rtol=1e-6, atol=1e-7 * np.abs(found).max())


class TestAlgebraic:
    def response(self, **changes: Any) -> Equations:
        usual: dict[str, Any] = {
            "inputs": {"total": "mol/m^3"},
            "parameters": {"K": "2 mol/m^3"},
            "algebraic_states": {"free": "1 mol/m^3"},
            "algebraic": {"free": "free + 2 * free^2 / K - total"},
            "outputs": {"signal": "free"},
        }
        return Equations(**{**usual, **changes})

    @pytest.mark.parametrize("total", [1e-9, 0.3, 12.0, 1e9])
    def test_a_response_follows_from_them(self, total: float):
        own = self.response()
        parameter, held = ca.SX.sym("K"), ca.SX.sym("total")
        found = own.signals(ca.SX(0, 1), held, parameter, ca.SX(0))["signal"]
        exact = parameter / 4 * (ca.sqrt(1 + 8 * held / parameter) - 1)
        for one, other in ((found, exact), (ca.jacobian(found, parameter), ca.jacobian(exact, parameter))):
            values = [float(ca.Function("f", [held, parameter], [it])(total, 2.0)) for it in (one, other)]
            assert values[0] == pytest.approx(values[1], rel=1e-6)

    def test_values_may_stand_in_derivatives_and_definitions(self):
        """An exchange that is in equilibrium at once: x' = -k z with z + z^2 = x."""
        own = Equations(
            states={"x": ""},
            derivatives={"x": "-loss"},
            define={"loss": "k * z"},
            parameters={"k": "1 1/s"},
            algebraic_states={"z": 1.0},
            algebraic={"z": "z + z^2 - x"},
            outputs={"loss": "loss"},
            integrator="radau",
            substeps=8,
        )
        (end,), _ = followed(own, [2.0], [], np.array([0.0, 1.5]))
        z = float(signaller(own)([end], [], own.nominal, 0.0))
        # (1 + 2 z) z' = -k z, so that ln z + 2 z = 2 - k t from z = 1 on.
        assert np.log(z) + 2 * z == pytest.approx(2.0 - 1.5, abs=1e-8)
        assert z + z**2 == pytest.approx(end, rel=1e-12)

    def test_equations_that_no_number_solves_are_no_number(self):
        own = self.response(algebraic={"free": "free^2 + K^2 + total^2"})
        assert np.isnan(float(own.signals(ca.DM(0, 1), ca.DM(1), ca.DM(2), ca.DM(0))["signal"]))


@pytest.mark.parametrize(
    ("keys", "key", "words"),
    [
        ({"integrator": "runge_kutta"}, "integrator", "followed by radau alone"),
        ({"integrator": "rado"}, "integrator", "did you mean radau?"),
        ({"algebraic": {}}, "algebraic", "the equation of c, what is 0, is missing"),
        ({"algebraic": {"c": "a", "d": "a"}}, "algebraic.d", "d is no algebraic state"),
        ({"algebraic": {"c": "a + b + z - 1"}}, "algebraic.c", "column 9: unknown name 'z'"),
        ({"algebraic": {"c": "a + b + c = 1"}}, "algebraic.c", "column 11"),
        (
            {"algebraic": {"c": "a + k1 * c"}},
            "algebraic.c",
            "column 5: a is a plain number, k1 * c is in 1/s",
        ),
        ({"algebraic": {"c": "a + b - 1"}}, "algebraic.c", "there is no algebraic state in it"),
        ({"algebraic_states": {"c": "much"}}, "algebraic_states.c", "much"),
        ({"algebraic_states": {"c": 0.5, "a": 1}}, "algebraic_states.a", "a is among the states already"),
        ({"parameters": {**ROBERTSON["parameters"], "c": 1}}, "parameters.c", "among the algebraic states"),
        ({"substeps": 0}, "substeps", "at least 1"),
        (
            {"algebraic_states": {"c": 0.5, "d": 0.5}, "algebraic": {"c": "a + b + c - 1", "d": "c - a"}},
            "algebraic",
            "d is in none of them: the index would not be 1",
        ),
    ],
)
def test_mistakes_are_named_by_key_and_column(keys: dict[str, Any], key: str, words: str):
    with pytest.raises(ProblemError) as error:
        system(CONSERVED, **keys)
    found = [issue for issue in error.value.issues if ".".join(map(str, issue.key)) == f"system.{key}"]
    assert any(words in issue.message for issue in found), error.value.issues


def tank(substeps: int, jacket: str = "285 K") -> oed.Problem:
    space = oed.SignalSpace(
        duration="2 min", samples=4, spline=oed.Spline(degree=0, coefficients=4), rest_to_rest=False
    )
    return oed.Problem(
        model=system(CSTR, substeps=substeps, parameters={**CSTR["parameters"], "T_jacket": jacket}),
        design=space.model_copy(update={"start": (900.0, 320.0)}),
        measurement=oed.Outputs(noise={"temperature": "0.5 K"}),
        limits=[oed.InputRange(input="T_feed", range=("320 K", "360 K"))],
        criterion="D",
        estimate=("k0", "cooling"),
    )


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
def test_a_design_is_better_than_a_steady_feed_and_certified_by_finer_steps():
    own, finer = tank(2), tank(4)
    steady = own.design.trajectory(np.full((4, 1), 350.0), own.fixed_starts)
    options = oed.Ipopt(starts=1, perturbations=0, second_stage="none")
    found = oed.solve(own, options, seed=0, workers=1)
    assert found.status is oed.Status.CONVERGED
    assert found.evaluation.feasible
    assert found.evaluation.objective > oed.evaluate(own, steady).objective + 1.0
    certified = oed.evaluate(finer, found.trajectory).objective
    assert found.evaluation.objective == pytest.approx(certified, abs=1e-4)


def test_a_step_that_is_not_solved_is_said_and_no_design():
    """In one step to where a reaction runs away."""
    own = tank(1, jacket="330 K")
    drive = own.design.trajectory(np.full((4, 1), 360.0), own.fixed_starts)
    with pytest.raises(NotFinite, match=r"not finite from .* s on; .* take more substeps"):
        score(own, drive)


STIFF = """
format: 1
name: stiff
system:
  kind: equations
  states: {a: 1, b: 0}
  inputs: {u: 1/s}
  parameters: {K: 0.5 1/s, F: 200 1/s}
  derivatives: {a: u - K * a - 0.1 * K * a * b, b: F * (sin(3 * a) - b)}
  outputs: {b: b}
experiment: {duration: 10 s, samples: 20, inputs: {u: {range: [0 1/s, 2 1/s]}}}
measurement: {kind: outputs, noise: {b: 0.01}}
criterion: D
"""
"""A fast state that follows a slow one, which explicit steps of 0.5 s do not."""


def test_a_stiff_system_by_too_long_steps_is_told_what_helps():
    with pytest.raises(UserMistake, match="take more `substeps` or `integrator: radau`"):
        oed.parse_study(STIFF).require_identifiable()
    radau = STIFF.replace("kind: equations", "kind: equations\n  integrator: radau")
    oed.parse_study(radau).require_identifiable()
