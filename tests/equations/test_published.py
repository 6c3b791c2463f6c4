"""Published optimal designs of systems given by equations, by the package's own criteria and solver."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

import oed
from oed.equations.limits import InputRange
from oed.equations.outputs import Outputs, Responses
from oed.equations.system import Equations
from oed.kernel.criteria import A, Criterion, D
from oed.kernel.identifiability import ambiguities
from oed.kernel.measurement.prior import Prior

OPTIONS = oed.Ipopt(starts=8, perturbations=0, second_stage="none")


def points(count: int) -> oed.SignalSpace:
    """So many settings of the inputs, each for itself."""
    spline = oed.Spline(degree=0, coefficients=count)
    return oed.SignalSpace(duration=count, samples=count, spline=spline, rest_to_rest=False)


def response(
    parameters: Mapping[str, str], output: str, most: str, count: int, criterion: Criterion, **parts
) -> oed.Problem:
    """A response to the time at which it is read, with a noise of 1 unless it is said."""
    system = Equations(parameters=parameters, inputs={"t": "s"}, outputs={"y": output})
    usual = {"measurement": Responses(noise={"y": 1.0})}
    return oed.Problem(
        model=system,
        design=points(count),
        limits=[InputRange(input="t", range=("0 s", most))],
        criterion=criterion,
        **{**usual, **parts},
    )


def best(problem: oed.Problem) -> tuple[np.ndarray, oed.Evaluation]:
    """The points, ascending, and what they say."""
    solution = oed.solve(problem, OPTIONS, seed=0, workers=1)
    assert solution.status is oed.Status.CONVERGED
    return np.sort(solution.trajectory.inputs.ravel()), solution.evaluation


@pytest.mark.slow
def test_box_and_lucas():
    """Two reactions one after the other [Box and Lucas, Design of experiments in non-linear situations,
    Biometrika 46, 1959]: 1.2295 and 6.8577 min, det F = .65677.
    """
    rates = {"k1": "0.7 1/min", "k2": "0.2 1/min"}
    output = "k1 / (k1 - k2) * (exp(-k2 * t) - exp(-k1 * t))"
    problem = response(rates, output, "20 min", 2, D(scaling="none"))
    times, found = best(problem)
    np.testing.assert_allclose(times / 60, [1.2295, 6.8577], rtol=1e-4)
    # Of rates in 1/min: their SI unit is 1/60 of it.
    assert np.exp(found.objective) / 60.0**4 == pytest.approx(0.65677, rel=1e-4)


@pytest.mark.slow
def test_compartmental_model():
    """Theophylline in a horse [Atkinson, Donev, Tobias, Optimum experimental designs, with SAS, 2007]."""
    rates = {"out": "0.05884 1/min", "into": "4.298 1/min", "size": "21.80"}
    problem = response(rates, "size * (exp(-out * t) - exp(-into * t))", "60 min", 3, D())
    times, _ = best(problem)
    # To the digits that are printed.
    assert np.all(np.abs(times / 60 - [0.2288, 1.3886, 18.417]) < [5e-5, 5e-5, 5e-4])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("criterion", "value"),
    [(D(scaling="none"), 6.864795 * np.log(10)), (A(scaling="none"), -(10**-2.236425))],
)
def test_rooney_and_biegler(criterion: Criterion, value: float):
    """One more reading after those at 1, 2, 3, 4, 5 and 7 [tests of Pyomo.DoE]: as late as may be.

    Rates are per hour there; counted in 3600 s they would be per second.
    """
    asymptote, rate, noise = 15.0, 0.5, 0.1
    known = np.array([1.0, 2, 3, 4, 5, 7])
    rows = np.column_stack([1 - np.exp(-rate * known), asymptote * known * np.exp(-rate * known)])
    covariance = np.linalg.inv(rows.T @ rows / noise**2)
    prior = Prior(parameters=("asymptote", "rate"), covariance=tuple(map(tuple, covariance.tolist())))
    problem = response(
        {"asymptote": "15", "rate": "0.5 1/s"},
        "asymptote * (1 - exp(-rate * t))",
        "10 s",
        1,
        criterion,
        measurement=Responses(noise={"y": noise}),
        prior=prior,
    )
    times, found = best(problem)
    np.testing.assert_allclose(times, [10.0], rtol=1e-5)
    assert found.objective == pytest.approx(value, rel=1e-5)


@pytest.mark.slow
def test_a_state_is_what_its_response_is():
    """One reaction after the other as differential equations says the same as their solution."""
    rates = {"k1": "0.7 1/min", "k2": "0.2 1/min"}
    system = Equations(
        states={"a": "", "b": ""},
        derivatives={"a": "-first", "b": "first - k2 * b"},
        define={"first": "k1 * a"},
        parameters=rates,
        outputs={"y": "b"},
        inputs={"idle": ""},
        substeps=40,
    )
    every = 60.0
    space = oed.SignalSpace(
        duration=8 * every, samples=8, spline=oed.Spline(degree=0, coefficients=8), rest_to_rest=False
    )
    space = space.model_copy(update={"start": (1.0, 0.0)})
    problem = oed.Problem(
        model=system,
        design=space,
        measurement=Outputs(noise={"y": 1.0}),
        limits=[InputRange(input="idle", range=(0.0, 1.0))],
        criterion=D(scaling="none"),
    )
    drive = space.trajectory(np.zeros((8, 1)), [[1.0, 0.0]])
    found = oed.evaluate(problem, drive)
    output = "k1 / (k1 - k2) * (exp(-k2 * t) - exp(-k1 * t))"
    closed = response(rates, output, "20 min", 8, D(scaling="none"))
    times = points(8).trajectory(every * np.arange(1.0, 9.0)[:, None], np.zeros((1, 0)))
    assert found.objective == pytest.approx(oed.evaluate(closed, times).objective, abs=1e-6)


def test_what_is_over_soon_is_identifiable():
    """In the first ten thousandths of the time in which it may be read."""
    problem = response({"rate": "1 1/s"}, "exp(-rate * t)", "100000 s", 1, D())
    oed.evaluate(problem, points(1).trajectory(np.array([[1.0]]), np.zeros((1, 0))))
    assert ambiguities(problem) == ()
