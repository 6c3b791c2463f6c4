"""Certificates of designs of points: optimal designs that are known, and designs that may not beat them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

import oed
from oed.bounds import UNKNOWN, Certificate, bound
from oed.bounds.point_designs import ON_GRID, point_designs, sensitivity_function
from oed.equations.limits import InputRange
from oed.equations.outputs import Outputs, Responses
from oed.equations.system import Equations
from oed.foundation.errors import ProblemError, UserMistake
from oed.kernel.criteria import A, Criterion, D, E
from oed.kernel.evaluation import evaluate
from oed.kernel.limit import BareLimit, Rows
from oed.kernel.measurement.prior import Prior

Array = npt.NDArray[np.float64]

TWO_STEPS = {"k1": "0.7 1/min", "k2": "0.2 1/min"}
SECOND = "k1 / (k1 - k2) * (exp(-k2 * t) - exp(-k1 * t))"
ABSORBED = {"out": "0.05884 1/min", "into": "4.298 1/min", "size": "21.80"}
LEVEL = "size * (exp(-out * t) - exp(-into * t))"
PARABOLA = "a + b * x + c * x^2"
SURFACE = "a + b * x + c * z + d * x * z + e * x^2 + f * z^2"
CRITERIA: tuple[Criterion, ...] = (D(), A(), E())


def space(count: int, **more: Any) -> oed.SignalSpace:
    spline = oed.Spline(degree=0, coefficients=count)
    return oed.SignalSpace(duration=count, samples=count, spline=spline, rest_to_rest=False, **more)


def problem_of(
    parameters: Mapping[str, str], output: str, ranges: Mapping[str, Any], count: int, **more: Any
) -> oed.Problem:
    """So many readings of an output with a noise of 1, for settings of inputs within ranges."""
    units = {name: "s" if isinstance(ends[0], str) else "" for name, ends in ranges.items()}
    given: dict[str, Any] = {
        "model": Equations(parameters=parameters, inputs=units, outputs={"y": output}),
        "design": space(count),
        "measurement": Responses(noise={"y": 1.0}),
        "limits": [InputRange(input=name, range=ends) for name, ends in ranges.items()],
        "criterion": D(),
    }
    return oed.Problem(**{**given, **more})


def polynomial(output: str, count: int, **more: Any) -> oed.Problem:
    names = [name for name in "abcdef" if name in output]
    ranges = {name: (-1, 1) for name in "xz" if name in output}
    return problem_of(dict.fromkeys(names, "1"), output, ranges, count, **more)


def scored(problem: oed.Problem, points: Array) -> float:
    points = np.reshape(points, (-1, len(problem.model.inputs)))
    return evaluate(problem, problem.design.trajectory(points, np.zeros((1, 0)))).objective


def climbed(problem: oed.Problem, rng: np.random.Generator, tries: int) -> float:
    """The best of random designs, their points moved one by one where that is better."""
    low, high = problem.input_bounds.T
    corners = np.array(list(itertools.product(*problem.input_bounds)))
    count, best = problem.design.all_samples, -np.inf
    design = rng.uniform(low, high, (count, len(low)))
    for _ in range(tries):
        trial = design.copy()
        place = rng.integers(count)
        kind = rng.integers(3)
        if kind == 0:
            trial[place] = rng.uniform(low, high)
        elif kind == 1:
            trial[place] = corners[rng.integers(len(corners))]
        else:
            trial[place] = np.clip(trial[place] + 0.02 * rng.normal(size=len(low)) * (high - low), low, high)
        value = scored(problem, trial)
        if value > best or not np.isfinite(best):
            design, best = trial, value
    return best


@pytest.mark.slow
def test_two_points_of_box_and_lucas_are_proved() -> None:
    problem = problem_of(TWO_STEPS, SECOND, {"t": ("0 s", "20 min")}, 2)
    certificate = bound(problem)
    # Where the derivative by time of the sum of logarithms vanishes, to all digits: by a fine grid twice.
    times = np.array([1.2295, 6.8577]) * 60
    for width in (1e-4, 2e-5):
        grid = times[:, None] * (1 + width * np.linspace(-1, 1, 5))
        trials = np.array(list(itertools.product(*grid)))
        times = max(trials, key=lambda one: scored(problem, one))
    found = scored(problem, times)
    assert 0 <= certificate.gap(found) < 1e-6
    assert "verified on a grid of 4,096 points" in certificate.method
    assert ON_GRID in certificate.assumptions
    assert not any(word in " ".join(certificate.assumptions) for word in ("drive", "wheel", "robot"))
    # Both are inside the range, which may as well be wider.
    assert certificate.widened is not None
    assert certificate.widened.upper_bound == pytest.approx(certificate.upper_bound, rel=1e-9)


@cache
def compartmental(kind: str) -> tuple[oed.Problem, Certificate]:
    """Of three readings, and its certificate."""
    criterion = next(one for one in CRITERIA if one.kind == kind)
    problem = problem_of(ABSORBED, LEVEL, {"t": ("0 s", "60 min")}, 3, criterion=criterion)
    return problem, bound(problem)


@pytest.mark.slow
def test_three_points_of_the_compartmental_model_are_proved() -> None:
    """Theophylline in a horse [Atkinson, Donev, Tobias, Optimum experimental designs, with SAS, 2007]."""
    problem, certificate = compartmental("D")
    found = scored(problem, np.array([0.2288, 1.3886, 18.417]) * 60)
    assert 0 <= certificate.gap(found) < 1e-6


@pytest.mark.slow
def test_quadratic_regression() -> None:
    """1/3 at each of -1, 0 and 1 is best for D; 1/4, 1/2, 1/4 for A; 1/5, 3/5, 1/5 for E [Pukelsheim,
    Optimal Design of Experiments, 1993, ch. 9].
    """
    for criterion, shares in zip(CRITERIA, [(1, 1, 1), (1, 2, 1), (1, 3, 1)], strict=True):
        problem = polynomial(PARABOLA, sum(shares), criterion=criterion)
        certificate = bound(problem)
        found = scored(problem, np.repeat([-1.0, 0.0, 1.0], shares))
        assert 0 <= certificate.gap(found) < 1e-6
        assert certificate.widened is not None
        wider = scored(problem, 1.001 * np.repeat([-1.0, 0.0, 1.0], shares))
        assert certificate.upper_bound < wider <= certificate.widened.upper_bound
    # Other numbers of readings cannot be shared out so: the bound of the last is in proportion all the same.
    more = bound(polynomial(PARABOLA, 2 * sum(shares) + 1, criterion=criterion))
    ratio = (2 * sum(shares) + 1) / sum(shares)
    assert more.gap(certificate.upper_bound) == pytest.approx(ratio - 1, rel=1e-6)


@pytest.mark.slow
def test_surfaces_on_a_square() -> None:
    # By D on any square, from the best shares of a fine grid.
    problem = polynomial(SURFACE, 9)
    grid = np.array(list(itertools.product(np.linspace(-1, 1, 11), repeat=2)))
    x, z = grid.T
    rows = np.stack([np.ones_like(x), x, z, x * z, x**2, z**2], axis=1)
    shares = np.full(len(rows), 1 / len(rows))
    for _ in range(600):
        matrix = rows.T @ (shares[:, None] * rows)
        shares *= np.einsum("ka,ab,kb->k", rows, np.linalg.inv(matrix), rows) / 6
    best = 6 * np.log(9) + np.linalg.slogdet(rows.T @ (shares[:, None] * rows))[1]
    certificate = bound(problem)
    assert best <= certificate.upper_bound <= best + 1e-4
    factorial = np.array(list(itertools.product((-1, 0, 1), repeat=2)))
    assert 0.02 < certificate.gap(scored(problem, factorial)) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "criterion"),
    # The grid is the same whatever the criterion, which a subset is another case of; the best mixtures by a
    # part of the parameters are tested by every criterion for themselves.
    [(0, E()), (1, D()), (2, A())],
    ids=lambda one: one.kind if isinstance(one, Criterion) else None,
)
def test_no_points_beat_the_bound(seed: int, criterion: Criterion) -> None:
    rng = np.random.default_rng(seed)
    low, high = np.sort(rng.uniform(0.1, 5, 2))
    models: list[tuple[dict[str, str], str, dict[str, Any]]] = [
        ({"top": "2", "half": "0.8"}, "top * x^1.3 / (half^1.3 + x^1.3)", {"x": (low, high)}),
        ({"a": "1", "b": "0.4", "c": "2"}, "a + c * exp(-b * x) * cos(z)", {"x": (0, high), "z": (-1, 2)}),
        ({"a": "1", "b": "0.5"}, "a * log(1 + b * x) + sinh(0.2 * x) * 2^(-b * x)", {"x": (0, high)}),
    ]
    parameters, output, ranges = models[seed]
    names = tuple(parameters)
    more: dict[str, Any] = {"criterion": criterion}
    if seed == 1:
        more |= {"criterion": criterion.model_copy(update={"subset": names[:2]})}
    if seed == 2:
        more |= {"prior": Prior(standard_deviations={names[1]: "30 %"})}
    problem = problem_of(parameters, output, ranges, len(names) + int(rng.integers(3)), **more)
    certificate = bound(problem)
    best = climbed(problem, rng, 60)
    assert np.isfinite(certificate.upper_bound)
    assert best <= certificate.upper_bound
    # Far from trivial: shares lose little to whole points.
    assert certificate.gap(best) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("criterion", [CRITERIA[0], CRITERIA[2]], ids=lambda one: one.kind)
def test_the_equivalence_theorem_holds_of_a_dense_grid(criterion: Criterion) -> None:
    problem, certificate = compartmental(criterion.kind)
    assert certificate.multiplier is not None
    times, values = sensitivity_function(problem, certificate.multiplier, 20001)
    # By finite differences of the curve itself.
    nominal = np.array([0.05884 / 60, 4.298 / 60, 21.80])

    def curve(one: Array) -> Array:
        return np.asarray(one[2] * (np.exp(-one[0] * times) - np.exp(-one[1] * times)))

    steps = np.diag(1e-6 * nominal)
    slopes = np.stack([(curve(nominal + one) - curve(nominal - one)) / 2e-6 for one in steps])
    expected = np.einsum("at,ab,bt->t", slopes, certificate.multiplier, slopes)
    np.testing.assert_allclose(values, expected, rtol=1e-6, atol=1e-9 * expected.max())
    most = criterion.trace_bound(certificate.multiplier, 3 * float(expected.max()))
    assert most <= certificate.upper_bound
    assert criterion.change(certificate.upper_bound, most, 3) < 1e-4


@pytest.mark.slow
def test_readings_of_several_kinds_and_runs() -> None:
    every = [Responses(noise={"y": 1.0}), Responses(noise={"y": 0.5}, every=2)]
    problem = polynomial(PARABOLA, 5, measurement=every, design=space(5, runs=2))
    designs = point_designs(problem)
    assert designs is not None
    # Per run, three settings are read by both and two by one.
    assert sorted(kind.total for kind in designs.kinds) == [4.0, 6.0]
    rng = np.random.default_rng(3)
    certificate = bound(problem)
    best = -np.inf
    for _ in range(25):
        table = rng.choice([-1.0, 0.0, 1.0], (10, 1))
        drive = problem.design.trajectory(table, np.zeros((2, 0)))
        best = max(best, evaluate(problem, drive).objective)
    assert best <= certificate.upper_bound
    assert certificate.gap(best) < 0.05


class Together(BareLimit):
    """All settings together are no more than `bounds`."""

    name, looks_at = "together", "inputs"
    bounds: float

    def rows(self, drive: Any) -> Rows:
        """One row."""
        return Rows(ca.sum1(ca.vec(drive.inputs)), np.array([-np.inf]), np.array([self.bounds]), 1.0, "")


@pytest.mark.slow
def test_further_limits_are_left_out_in_words() -> None:
    plain = polynomial("a + b * x + c * z", 3)
    ranges = plain.limits
    limited = polynomial("a + b * x + c * z", 3, limits=[*ranges, Together(bounds=1.0)])
    whole, without = bound(plain), bound(limited)
    assert "left out" not in " ".join(whole.assumptions)
    assert "together left out" in without.assumptions
    assert without.upper_bound == whole.upper_bound


@pytest.mark.slow
def test_systems_with_states_have_none() -> None:
    decay = Equations(
        parameters={"k": "1 1/s"}, states={"x": ""}, derivatives={"x": "-k * x + u"}, inputs={"u": "1/s"},
        outputs={"y": "x"},
    )  # fmt: skip
    problem = oed.Problem(
        model=decay,
        design=space(5, start=(1.0,)),
        measurement=Outputs(noise={"y": 0.1}),
        limits=[InputRange(input="u", range=("0 1/s", "1 1/s"))],
        criterion="D",
    )
    for runs in (1, 2):
        several = oed.Problem(
            model=decay,
            design=space(5, start=(1.0,), runs=runs),
            measurement=problem.measurement,
            limits=problem.limits,
            criterion="D",
        )
        certificate = bound(several)
        assert (certificate.upper_bound, certificate.method) == (np.inf, UNKNOWN)
    with pytest.raises(ProblemError, match="has no points"):
        sensitivity_function(problem, np.eye(1))


@pytest.mark.slow
def test_what_cannot_be_drawn_is_refused_in_words() -> None:
    with pytest.raises(UserMistake, match="one input, got 2"):
        sensitivity_function(polynomial(SURFACE, 6), np.eye(6))
    with pytest.raises(UserMistake, match=r"expected \(3, 3\), got \(2, 2\)"):
        sensitivity_function(polynomial(PARABOLA, 3), np.eye(2))


@pytest.mark.slow
def test_where_one_point_may_say_anything_there_is_no_bound() -> None:
    """The power's derivative by its exponent has a logarithm of 0 at the end of the range."""
    whole, problem = (
        problem_of({"top": "2", "h": "1.3"}, "top * x^h", {"x": (low, 5)}, 2) for low in (0, 0.01)
    )
    assert bound(whole).upper_bound == np.inf
    best = climbed(problem, np.random.default_rng(0), 80)
    assert 0 <= bound(problem).gap(best) < 0.02


def test_points_that_identify_nothing_have_no_bound() -> None:
    problem = polynomial("a + b * x + c * x", 4)
    assert bound(problem).upper_bound == np.inf
