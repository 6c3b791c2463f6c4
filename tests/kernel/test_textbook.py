"""Published optimal designs of regressions, found by the package's own criteria and solver."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import pytest

import oed
from oed.kernel.criteria import A, Criterion, D, E, G, I, Leg, ModifiedE
from oed.kernel.limit import InputLimit
from oed.robots.models import Input, Parameter
from oed.robots.sensors import regression

BACK = 1000.0
"""Past this input a curve is driven backwards: input x + 2 BACK undoes what x did."""


class Curve(oed.Model):
    """A curve as a robot on rails: the input is a point, the forward speed the curve's height there."""

    inputs: ClassVar[tuple[Input, ...]] = (Input("point", "point", ""),)
    values: ClassVar[dict[str, float]]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(name, value, "") for name, value in self.values.items())

    def twist(self, inputs, parameters):
        back = inputs[0] > BACK
        height = self.height(ca.if_else(back, inputs[0] - 2 * BACK, inputs[0]), parameters)
        return ca.vertcat(ca.if_else(back, -height, height), 0, 0)

    @abstractmethod
    def height(self, point, parameters): ...


class Quadratic(Curve):
    kind: Literal["quadratic"] = "quadratic"
    values: ClassVar[dict[str, float]] = {"constant": 1.0, "slope": 1.0, "curvature": 1.0}

    def height(self, point, parameters):
        return parameters[0] + parameters[1] * point + parameters[2] * point**2


class BoxLucas(Curve):
    """The intermediate product of two reactions [Box and Lucas, Biometrika 46, 1959]."""

    kind: Literal["box_lucas"] = "box_lucas"
    values: ClassVar[dict[str, float]] = {"theta_1": 0.7, "theta_2": 0.2}

    def height(self, point, parameters):
        first, second = parameters[0], parameters[1]
        return first / (first - second) * (ca.exp(-second * point) - ca.exp(-first * point))


class Observations(oed.Measurement):
    """One reading of the curve in each period."""

    kind: Literal["observations"] = "observations"

    def blocks(self, drive):
        model, count = drive.model, drive.inputs.shape[0]
        point, parameters = ca.SX.sym("x"), ca.SX.sym("p", len(model.parameters))
        gradient = ca.gradient(model.height(point, parameters), parameters)
        rows = ca.Function("rows", [point, parameters], [ca.densify(gradient)]).map(count)
        design = rows(drive.inputs.T, ca.repmat(drive.parameters, 1, count)).T
        names = [parameter.name for parameter in model.parameters]
        return (regression("curve", design, names, model.nominal, units=[""] * len(names), noise=1.0),)


class Interval(InputLimit):
    """Where the curve may be observed."""

    name: ClassVar[str] = "interval"
    quantity: ClassVar[str] = "point"
    unit: ClassVar[str] = ""

    def rows(self, drive):
        return self.bounded(drive.input_values, drive.model)

    def input_bounds(self, model):
        return self.bounds_by_name(model)


def curve_problem(
    curve: Curve, interval: tuple[float, float], count: int, criterion: Criterion
) -> oed.Problem:
    return oed.Problem(
        model=curve,
        design=oed.DesignSpace(
            duration=count,
            samples=count,
            spline=oed.Spline(degree=0, coefficients=count),
            rest_to_rest=False,
        ),
        measurement=Observations(),
        limits=(Interval(bounds=interval),),
        criterion=criterion,
    )


def best(
    curve: Curve, interval: tuple[float, float], count: int, criterion: Criterion
) -> tuple[np.ndarray, oed.Evaluation]:
    """The best `count` points, ascending, and what they tell."""
    # More points have more arrangements that no small change makes better.
    options = oed.Ipopt(starts=8 if count > 5 else 4, perturbations=0, second_stage="none")
    solution = oed.solve(curve_problem(curve, interval, count, criterion), options, workers=1)
    assert solution.status is oed.Status.CONVERGED
    return np.sort(solution.trajectory.inputs.ravel()), solution.evaluation


QUADRATIC = {
    # Weights 1/5, 3/5, 1/5 and lambda_min 1/5 [Pukelsheim, Optimal Design of Experiments].
    "E": (E(scaling="none"), [-1, 0, 0, 0, 1], 5 / 5),
    # Equal weights, det 4/27 [Fedorov; Atkinson, Donev and Tobias].
    "D": (D(scaling="none"), [-1, 0, 1], math.log(27 * 4 / 27)),
    "D, twice": (D(scaling="none"), [-1, -1, 0, 0, 1, 1], math.log(6**3 * 4 / 27)),
    # Weights 1/4, 1/2, 1/4, tr M^-1 = 8.
    "A": (A(scaling="none"), [-1, 0, 0, 1], -8 / 4),
    # D_s for the curvature alone: the extrema of the Chebyshev polynomial, 1/4, 1/2, 1/4, variance 4
    # [Kiefer and Wolfowitz 1959].
    "D_s": (D(scaling="none", subset=("curvature",)), [-1, 0, 0, 1], math.log(4 / 4)),
    # Weights s/2, 1 - s, s/2: the eigenvalues other than s have the smallest ratio at s = 1/3.
    "modified E": (ModifiedE(scaling="none"), [-1, 0, 0, 0, 0, 1], -(3 + 2 * math.sqrt(2))),
}


@pytest.mark.parametrize(("criterion", "points", "value"), QUADRATIC.values(), ids=QUADRATIC.keys())
@pytest.mark.slow
def test_quadratic_regression(criterion: Criterion, points: list[int], value: float):
    found, evaluation = best(Quadratic(), (-1, 1), len(points), criterion)
    np.testing.assert_allclose(found, points, rtol=0, atol=1e-4)
    assert evaluation.objective == pytest.approx(value, abs=1e-6)


def quadratic_rows(points: Sequence[float]) -> np.ndarray:
    """f(x) = (1, x, x^2), row by row."""
    return np.vander(np.asarray(points), 3, increasing=True)


@pytest.mark.slow
def test_largest_prediction_variance_of_the_best_determinant_is_parameters_over_points():
    # The equivalence theorem [Kiefer and Wolfowitz, Canad. J. Math. 12, 1960].
    points, evaluation = best(Quadratic(), (-1, 1), 6, D(scaling="none"))
    inverse = np.linalg.inv(evaluation.information["curve"])
    grid, support = quadratic_rows(np.linspace(-1, 1, 2001)), quadratic_rows(points)
    assert np.einsum("xi,ij,xj->x", grid, inverse, grid).max() == pytest.approx(3 / 6, abs=1e-6)
    at_support = np.einsum("xi,ij,xj->x", support, inverse, support)
    np.testing.assert_allclose(at_support, 3 / 6, rtol=0, atol=1e-6)


def there_and_back(points: Sequence[float]) -> tuple[Leg, ...]:
    """Legs that end at the curve's height at each point in turn, with a leg back to 0 in between."""
    ways = [x for point in points for x in (float(point), float(point) + 2 * BACK)]
    return tuple(Leg(inputs=(x,), duration=1) for x in ways)


@pytest.mark.slow
def test_best_predictions_over_an_interval_have_the_best_determinant():
    criterion = G(scaling="none", test_drive=there_and_back(np.linspace(-1, 1, 9)))
    points, evaluation = best(Quadratic(), (-1, 1), 3, criterion)
    np.testing.assert_allclose(points, [-1, 0, 1], rtol=0, atol=1e-3)
    assert evaluation.objective == pytest.approx(-1, abs=1e-6)


CHEBYSHEV = (-0.7946544722917661, -0.1875924740850799, 0.1875924740850799, 0.7946544722917661)
"""Nodes of equal weight that integrate polynomials of degree 5 over [-1, 1] exactly."""


@pytest.mark.slow
def test_best_mean_prediction_over_an_interval():
    # Weights 1/4, 1/2, 1/4; the mean variance 8/15 counts half, for the legs back have none.
    criterion = I(scaling="none", test_drive=there_and_back(CHEBYSHEV))
    points, evaluation = best(Quadratic(), (-1, 1), 4, criterion)
    np.testing.assert_allclose(points, [-1, 0, 0, 1], rtol=0, atol=1e-4)
    assert evaluation.objective == pytest.approx(-8 / 15 / 2, abs=1e-6)


def test_box_and_lucas_two_observations():
    times, _ = best(BoxLucas(), (0, 20), 2, D(scaling="none"))
    np.testing.assert_allclose(times, [1.2295, 6.8577], rtol=0, atol=5e-5)


@pytest.mark.slow
def test_best_times_do_not_depend_on_the_scaling():
    scaled, _ = best(BoxLucas(), (0, 20), 2, D(scaling={"theta_1": 1.0, "theta_2": 100.0}))
    np.testing.assert_allclose(scaled, [1.2295, 6.8577], rtol=0, atol=5e-5)
