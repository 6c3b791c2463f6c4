"""Systems given by equations: what they are made of, how they step, and mistakes in them by their places."""

from __future__ import annotations

import pickle
import subprocess
import sys
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import oed
from oed.equations.limits import InputRange
from oed.equations.outputs import Outputs, Responses
from oed.equations.system import Equations
from oed.foundation.errors import NotFinite, PartError, ProblemError
from oed.kernel.criteria import D
from oed.kernel.dynamics.system import carrier, stepper

TANK: dict[str, Any] = {
    "states": {"amount": "mol", "volume": "m^3"},
    "derivatives": {"amount": "flow * feed - reaction * volume", "volume": "flow"},
    "inputs": {"flow": "m^3/s"},
    "define": {"reaction": "k * concentration^2", "concentration": "amount / volume"},
    "parameters": {"k": "2e-3 l/mol/s", "feed": "1.5 mol/l"},
    "outputs": {"measured": "concentration"},
}
"""A tank that is filled, with a reaction of second order."""
STATE, FLOW = [900.0, 1.2], [0.01]


def tank(**keys: Any) -> Equations:
    return Equations(**{**TANK, **keys})


class TestParts:
    def test_are_in_si_units(self):
        system = tank()
        assert system.states == ("amount", "volume")
        assert system.state_units == ("mol", "m^3")
        assert system.input_names == ("flow",)
        assert [(one.name, one.unit) for one in system.parameters] == [
            ("k", "m^3/s/mol"),
            ("feed", "mol/m^3"),
        ]
        assert system.nominal == pytest.approx([2e-6, 1500.0])
        assert {name: one.text for name, one in system.output_dimensions.items()} == {"measured": "mol/m^3"}

    def test_definitions_may_stand_in_any_order(self):
        assert [name for name, _ in tank().definitions] == ["concentration", "reaction"]

    def test_are_equal_and_kept_by_what_they_say(self):
        one, other = tank(), pickle.loads(pickle.dumps(tank()))
        assert one == other
        assert hash(one) == hash(other)
        assert stepper(one) is stepper(other)
        assert tank(substeps=3) != one


class TestStep:
    def exact(self, seconds: float, parameters: np.ndarray | None = None) -> np.ndarray:
        k, feed = tank().nominal if parameters is None else parameters

        def rates(_: float, state: np.ndarray) -> list[float]:
            amount, volume = state
            return [FLOW[0] * feed - k * amount**2 / volume, FLOW[0]]

        return solve_ivp(rates, (0, seconds), STATE, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]

    def stepped(self, seconds: float, substeps: int) -> np.ndarray:
        system = tank(substeps=substeps, parameters={"k": "2e-1 l/mol/s", "feed": "1.5 mol/l"})
        return np.array(stepper(system)(STATE, FLOW, system.nominal, seconds)).ravel()

    def test_of_no_time_changes_nothing(self):
        assert np.array(stepper(tank())(STATE, FLOW, tank().nominal, 0.0)).ravel() == pytest.approx(STATE)

    @pytest.mark.slow
    def test_is_of_fourth_order(self):
        exact = self.exact(20.0, np.array([2e-4, 1500.0]))
        off = [np.abs(self.stepped(20.0, count) - exact)[0] for count in (20, 40)]
        assert 12 < off[0] / off[1] < 20

    def test_sensitivities_are_those_of_the_exact_solution(self):
        system = tank(substeps=20)
        begin = np.hstack([np.zeros((2, 2)), np.eye(2)])
        found = np.array(carrier(system)(begin, STATE, FLOW, system.nominal, 50.0))[:, :2]
        for place, size in enumerate(system.nominal):
            change = 1e-4 * size * np.eye(2)[place]
            ends = [self.exact(50.0, system.nominal + sign * change) for sign in (1, -1)]
            assert found[:, place] == pytest.approx((ends[0] - ends[1]) / (2e-4 * size), rel=1e-6, abs=1e-5)

    def test_without_states_there_is_only_a_response(self):
        system = Equations(parameters={"a": "2 m"}, inputs={"x": ""}, outputs={"y": "a * x^2"})
        assert system.states == ()
        found = system.signals(ca.DM(0, 1), ca.DM([3]), ca.DM([2]), ca.DM(0))
        assert float(found["y"]) == 18.0


@pytest.mark.parametrize(
    ("keys", "key", "words"),
    [
        ({"states": {"amount": "mol", "volume": "l"}}, "states.volume", "expected an SI unit such as m^3"),
        ({"states": {"amount": "mol", "volume": "cube"}}, "states.volume", "cube"),
        ({"states": {"amount": "mol", "k": "m^3"}}, "parameters.k", "k is among the states already"),
        ({"inputs": {"flow": "m^3/s", "exp": "m"}}, "inputs.exp", "is a function or a constant already"),
        ({"inputs": {"2x": "m", "flow": "m^3/s"}}, "inputs.2x", "is no name"),
        ({"parameters": {"k": "fast", "feed": "1.5 mol/l"}}, "parameters.k", "fast"),
        ({"derivatives": {"amount": "flow * feed"}}, "derivatives", "the derivative of volume is missing"),
        ({"derivatives": {**TANK["derivatives"], "x": "1"}}, "derivatives.x", "x is no state"),
        (
            {"derivatives": {**TANK["derivatives"], "volume": "flow * fed"}},
            "derivatives.volume",
            "column 8: unknown name 'fed'; did you mean feed?",
        ),
        (
            {"derivatives": {**TANK["derivatives"], "volume": "flow + volume"}},
            "derivatives.volume",
            "column 8: flow is in m^3/s, volume is in m^3: they cannot be added",
        ),
        (
            {"derivatives": {**TANK["derivatives"], "volume": "flow * feed"}},
            "derivatives.volume",
            "column 1: flow * feed is in mol/s, expected m^3/s",
        ),
        ({"define": {**TANK["define"], "reaction": "k *"}}, "define.reaction", "column 4"),
        (
            {"define": {"reaction": "concentration", "concentration": "reaction"}},
            "define.",
            "is defined by itself",
        ),
        ({"outputs": {}}, "outputs", "there is nothing to read"),
        ({"outputs": {"y": "exp(amount)"}}, "outputs.y", "column"),
        ({"outputs": {"y": "__import__('os')"}}, "outputs.y", "column"),
        ({"substeps": 0}, "substeps", "at least 1"),
    ],
)
def test_mistakes_are_named_by_key_and_column(keys: dict[str, Any], key: str, words: str):
    with pytest.raises(ProblemError) as error:
        tank(**keys)
    found = [
        issue for issue in error.value.issues if ".".join(map(str, issue.key)).startswith(f"system.{key}")
    ]
    assert any(words in issue.message for issue in found), error.value.issues


def test_all_mistakes_are_named_at_once():
    with pytest.raises(ProblemError) as error:
        tank(outputs={"y": "amout"}, parameters={"k": "x", "feed": "1.5 mol/l"}, substeps=0)
    assert len(error.value.issues) == 2


def problem(**parts: Any) -> oed.Problem:
    space = oed.SignalSpace(duration=60.0, samples=12, spline=oed.Spline(coefficients=6), rest_to_rest=False)
    usual: dict[str, Any] = {
        "model": tank(),
        "design": space.model_copy(update={"start": tuple(STATE)}),
        "measurement": Outputs(noise={"measured": "10 mol/m^3"}),
        "limits": [InputRange(input="flow", range=("0 m^3/s", "20 l/s"))],
        "criterion": D(),
    }
    return oed.Problem(**{**usual, **parts})


class TestProblem:
    def test_limits_have_the_units_of_the_inputs(self):
        assert problem().input_bounds.tolist() == [[0.0, 0.02]]

    @pytest.mark.slow
    def test_a_design_keeps_them_and_is_better_than_a_steady_flow(self):
        own = problem()
        steady = own.design.trajectory(np.full((6, 1), 0.01), own.fixed_starts)
        found = oed.solve(own, oed.Ipopt(starts=1, perturbations=0, second_stage="none"), seed=0, workers=1)
        assert found.evaluation.feasible
        assert found.evaluation.objective > oed.evaluate(own, steady).objective + 0.1

    @pytest.mark.parametrize(
        ("parts", "key", "words"),
        [
            ({"measurement": Outputs(noise={"level": 1})}, "noise.level", "the system has no such output"),
            ({"measurement": Outputs(noise={"measured": "1 m"})}, "noise.measured", "its noise in m"),
            ({"measurement": Outputs(noise={"measured": 0})}, "noise.measured", "above 0"),
            ({"limits": [InputRange(input="flo", range=(0, 1))]}, "limits.flo", "did you mean flow?"),
            ({"limits": [InputRange(input="flow", range=("0 m", "1 m"))]}, "limits.flow", "got some in m"),
        ],
    )
    def test_mistakes(self, parts: dict[str, Any], key: str, words: str):
        with pytest.raises(ProblemError) as error:
            problem(**parts)
        assert any(key in ".".join(map(str, one.key)) and words in one.message for one in error.value.issues)

    def test_a_range_rises(self):
        with pytest.raises(PartError, match=r"expected \[least, largest\]"):
            InputRange(input="flow", range=("1 m", "0 m"))

    def test_responses_are_those_of_equations(self):
        assert Responses(noise={"measured": 1}).issues(tank(), 3) != []


@pytest.mark.slow
def test_drives_that_go_beyond_all_bounds_are_the_worst_and_no_error():
    """The rate a x^2 + u leads to infinity after a while, unless it is held down."""
    system = Equations(
        states={"x": ""},
        derivatives={"x": "a * x^2 + u"},
        parameters={"a": "1 1/s"},
        inputs={"u": "1/s"},
        outputs={"y": "x"},
    )
    space = oed.SignalSpace(
        duration=4.0, samples=20, spline=oed.Spline(degree=1, coefficients=8), rest_to_rest=False
    ).model_copy(update={"start": (0.1,)})
    problem = oed.Problem(
        model=system,
        design=space,
        measurement=Outputs(noise={"y": 0.1}),
        limits=[InputRange(input="u", range=("-1 1/s", "0.5 1/s"))],
        criterion=D(),
    )
    with pytest.raises(NotFinite, match=r"system: x: not finite from .* s on"):
        oed.evaluate(problem, space.trajectory(np.full((8, 1), 0.5), problem.fixed_starts))
    search = oed.Ipopt(starts=1, perturbations=0, second_stage="none", max_iterations=10)
    found = oed.solve(problem, search, seed=0, workers=1)
    assert found.evaluation is not None
    assert np.isfinite(found.evaluation.objective)


def test_a_system_without_inputs_is_at_rest():
    system = Equations(
        states={"x": ""}, derivatives={"x": "-k * x"}, parameters={"k": "1 1/s"}, outputs={"y": "x"}
    )
    space = oed.SignalSpace(duration=2.0, samples=20, spline=oed.Spline(degree=0, coefficients=20))
    own = oed.Problem(
        model=system,
        design=space.model_copy(update={"start": (1.0,)}),
        measurement=Outputs(noise={"y": 0.1}),
        limits=[],
        criterion=D(scaling="none"),
    )
    assert space.rest_to_rest
    found = oed.evaluate(own, oed.Trajectory.from_samples(np.zeros((20, 0)), 2.0, [1.0], rest_to_rest=False))
    times = np.linspace(0, 2, 21)
    assert found.objective == pytest.approx(np.log(np.sum((times * np.exp(-times) / 0.1) ** 2)), rel=1e-6)
    assert found.feasible


@pytest.mark.slow
def test_where_to_begin_may_be_all_that_is_chosen():
    """An unknown by itself is both a row and a column: that ended in a mismatch of dimensions."""
    system = Equations(
        states={"x": ""}, derivatives={"x": "-k * x"}, parameters={"k": "1 1/s"}, outputs={"y": "x"}
    )
    spline = oed.Spline(degree=0, coefficients=4)
    own = oed.Problem(
        model=system,
        design=oed.SignalSpace(duration=2.0, samples=4, spline=spline, start_bounds=((1.0, 3.0),)),
        measurement=Outputs(noise={"y": 0.1}),
        limits=[],
        criterion=D(),
    )
    found = oed.solve(own, oed.Ipopt(starts=2, perturbations=0, second_stage="none"), seed=0, workers=1)
    assert found.trajectory is not None
    assert found.trajectory.starts.item() == pytest.approx(3.0, rel=1e-6)


@pytest.mark.slow
def test_a_solution_is_shown_in_the_units_of_its_parameters():
    """And has no path, as the system does not move through space."""
    system = oed.Equations(inputs={"t": "s"}, parameters={"k": "0.7 1/min"}, outputs={"left": "exp(-k * t)"})
    problem = oed.Problem(
        model=system,
        design=oed.SignalSpace(
            duration=1, samples=1, spline=oed.Spline(degree=0, coefficients=1), rest_to_rest=False
        ),
        measurement=oed.Responses(noise={"left": 0.01}),
        limits=[oed.InputRange(input="t", range=("0 min", "20 min"))],
        criterion="D",
    )
    solution = oed.solve(problem, oed.Ipopt(starts=1, perturbations=0), seed=0)
    # The best time is 1 / k, where the error is 0.01 e k.
    assert f"{0.01 * np.e * 0.7:.3f} 1/min" in str(solution)
    assert "path length" not in str(solution)


LIST = """
import sys, oed
system = oed.Equations(states={"a": ""}, derivatives={"a": "u - k * a"}, parameters={"k": "0.5 1/s"},
                       inputs={"u": "1/s"}, outputs={"a": "a", "b": "2 * a"})
problem = oed.Problem(model=system, design=oed.SignalSpace(duration=6, samples=12, start=(0.2,)),
                      measurement=[oed.Outputs(noise={"a": 0.1}), oed.Outputs(noise={"b": 0.1})],
                      limits=[oed.InputRange(input="u", range=("0 1/s", "2 1/s"))], criterion="D")
print(problem.measurement.kind, "oed.robots.sensors" in sys.modules)
"""


@pytest.mark.slow
def test_sensors_in_a_list_need_no_robots():
    """It was an error unless somebody had imported the robots' sensors before."""
    done = subprocess.run([sys.executable, "-c", LIST], capture_output=True, text=True, check=True)
    assert done.stdout == "several False\n"
