"""How far drives by a system's own integrator are from those by SUNDIALS: against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from stiff_systems import CONSERVED, CSTR, ROBERTSON, system

import oed
from oed.equations.system import Equations
from oed.foundation.arguments import WrongKind
from oed.foundation.errors import NotFinite, UserMistake
from oed.kernel.scorer import score

EXCHANGE: dict[str, Any] = {
    "states": {"x": ""},
    "derivatives": {"x": "u - k * x"},
    "inputs": {"u": "1/s"},
    "parameters": {"k": "0.5 1/s"},
    "outputs": {"y": "x"},
}
"""A state that follows an input with a lag: its solution and its derivative are known."""
SECONDS, PERIODS = 6.0, 6


def problem(model: Equations, start: tuple[float, ...], noise: dict[str, Any], **parts: Any) -> oed.Problem:
    space = oed.SignalSpace(
        duration=parts.pop("seconds", SECONDS),
        samples=PERIODS,
        spline=oed.Spline(degree=0, coefficients=PERIODS),
        rest_to_rest=False,
        runs=parts.pop("runs", 1),
    )
    sensor = parts.pop("sensor", oed.Outputs)
    inputs = [
        oed.InputRange(input=one.name, range=(f"0 {one.unit}", f"1000 {one.unit}")) for one in model.inputs
    ]
    return oed.Problem(
        model=model,
        design=space.model_copy(update={"start": start}),
        measurement=sensor(noise=noise),
        limits=inputs,
        criterion=oed.D(scaling="none"),
        **parts,
    )


def checked(own: oed.Problem, inputs: np.ndarray) -> oed.IntegrationError:
    trajectory = own.design.trajectory(inputs, own.fixed_starts)
    return oed.validate_integration(own, trajectory)


def lagged(inputs: np.ndarray, start: float, rate: float) -> np.ndarray:
    """States of the exchange at the samples."""
    length, found = SECONDS / PERIODS, [start]
    for u in inputs:
        found.append(u / rate + (found[-1] - u / rate) * np.exp(-rate * length))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["runge_kutta", "radau"])
def test_the_information_is_that_of_the_closed_form(integrator: str):
    inputs = np.array([1.0, 0.0, 2.0, 0.0, 0.0, 1.0])
    own = problem(system(EXCHANGE, integrator=integrator, substeps=1), (0.3,), {"y": 0.1})
    found = checked(own, inputs[:, None])
    change = 1e-3
    ends = {share: lagged(inputs, 0.3, 0.5 + share * change) for share in (-2, -1, 1, 2)}
    slopes = (8 * (ends[1] - ends[-1]) - (ends[2] - ends[-2])) / (12 * change)
    assert np.exp(found.objective) == pytest.approx(np.sum(slopes**2) / 0.1**2, rel=1e-8)
    exact = score(own, own.design.trajectory(inputs[:, None], own.fixed_starts)).objective
    assert found.own_objective == exact
    # With one parameter the determinant is the information itself.
    assert found.information == pytest.approx(abs(np.expm1(exact - found.objective)), rel=1e-5)
    assert found.standard_errors["k"] == pytest.approx(abs(np.expm1((found.objective - exact) / 2)), rel=1e-5)
    assert 1e-7 < found.information < 1e-2


def test_differences_are_shares_and_standard_deviations():
    inputs = np.array([1.0, 0.0, 2.0, 0.0, 0.0, 1.0])
    own = problem(system(EXCHANGE, substeps=1), (0.3,), {"y": 0.1})
    found = checked(own, inputs[:, None])
    evaluation = score(own, own.design.trajectory(inputs[:, None], own.fixed_starts))
    exact = lagged(inputs, 0.3, 0.5)
    off = np.abs(evaluation.states[:, 0] - exact).max()
    assert found.states["x"] == pytest.approx(off / exact.max(), rel=1e-5)
    assert found.outputs["y"] == pytest.approx(found.states["x"], rel=1e-9)
    assert found.readings == pytest.approx(off / 0.1, rel=1e-5)


@pytest.mark.slow
def test_finer_steps_differ_less_and_the_worst_is_named():
    tank = {name: CSTR[name] for name in CSTR if name != "integrator"}
    feeds = np.array([350.0, 340, 350, 345, 330, 340])[:, None]
    found = []
    for integrator, substeps in (("runge_kutta", 1), ("radau", 2), ("radau", 16)):
        model = system(tank, integrator=integrator, substeps=substeps)
        noise = {"temperature": "0.5 K"}
        estimated = ("k0", "cooling")
        own = problem(model, (900.0, 320.0), noise, estimate=estimated, seconds=180.0)
        found.append(checked(own, feeds))
    coarse, middle, fine = (one.information for one in found)
    assert coarse > 10 * middle > 1000 * fine
    assert fine < 1e-7
    assert all(set(one.standard_errors) == {"k0", "cooling"} for one in found)
    assert found[0].sentence.endswith("from that by CVODES")
    assert str(found[0]).startswith("Integration: the information differs by")
    assert "(temperature)" in str(found[0])


@pytest.mark.slow
def test_algebraic_states_are_idas_and_say_the_same():
    """Robertson's reactions, by three derivatives or by two and their conservation."""
    starts = {"conserved": (0.9, 2.5e-5), "all": (0.9, 2.5e-5, 0.1 - 2.5e-5)}
    idle = {"inputs": {"idle": ""}, "outputs": {"rest": "c"}}
    models = {
        "conserved": system(CONSERVED, **idle),
        "all": system(ROBERTSON, **idle),
    }
    found = {}
    for name, model in models.items():
        own = problem(model, starts[name], {"rest": 1e-3})
        found[name] = checked(own, np.zeros((PERIODS, 1)))
    assert (found["conserved"].integrator, found["all"].integrator) == ("IDAS", "CVODES")
    assert found["conserved"].objective == pytest.approx(found["all"].objective, abs=1e-6)
    for one in found.values():
        assert max(one.states.values()) < 1e-5
        assert max(one.sensitivities.values()) < 1e-3


@pytest.mark.slow
def test_rates_in_periods_and_several_runs():
    """What is read in the middle of periods, of two runs, each from its own start."""
    inputs = np.array([1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0])
    found = {}
    for substeps in (1, 4):
        model = system(EXCHANGE, integrator="radau", substeps=substeps)
        own = problem(model, (0.3,), {"y": 0.1}, sensor=oed.Rates, runs=2)
        found[substeps] = checked(own, inputs[:, None])
    assert found[1].information > 100 * found[4].information > 0
    assert found[1].objective == pytest.approx(found[4].objective, abs=1e-7)


def test_what_cannot_be_integrated_is_refused():
    response = Equations(parameters={"a": "1"}, inputs={"x": ""}, outputs={"y": "a * x"})
    own = problem(response, (), {"y": 1.0}, sensor=oed.Responses)
    with pytest.raises(UserMistake, match="have states"):
        checked(own, np.ones((PERIODS, 1)))
    with pytest.raises(WrongKind):
        oed.validate_integration(own, None)


def test_a_drive_that_is_not_finite_is_refused():
    model = system(EXCHANGE, derivatives={"x": "u - k * x + k * x^3"})
    with pytest.raises(NotFinite):
        checked(problem(model, (3.0,), {"y": 0.1}), np.ones((PERIODS, 1)))
