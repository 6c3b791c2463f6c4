"""Problems whose inputs are signals of several kinds, and whose starts are chosen within bounds."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from builders import problem_of as robot_problem
from written_out import WrittenOut, called

import oed
from oed.kernel.criteria import D
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.signals import (
    Constant,
    Fourier,
    PiecewiseConstant,
    PiecewiseLinear,
    Signal,
    SplineSignal,
)
from oed.kernel.limit import Limit, Rows
from oed.kernel.scorer import score
from oed.optimize.terms.terms import Terms
from oed.optimize.transcription.coarse import SearchGrid
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.frame import Frame
from oed.optimize.transcription.perturbations import perturbed_design
from oed.optimize.transcription.starting_points import random_drives, start_bounds
from oed.robots.space import DesignSpace

STEPS = (PiecewiseConstant(pieces=5), Constant(), Fourier(harmonics=2))
SMOOTH = (PiecewiseLinear(pieces=3), Constant(shared=True), SplineSignal(degree=2, coefficients=6))
MIXED = [STEPS, SMOOTH]
RANGES = {"u": (0.5, 2.0), "v": (0.1, 1.0), "w": ("0 1/s", "0.5 1/s")}


def problem_of(signals: tuple[Signal, ...] = STEPS, samples: int = 24, **parts: Any) -> oed.Problem:
    """Two reactions whose rates two inputs multiply, fed by a third; two runs, one state chosen."""
    system = oed.Equations(
        states={"a": "", "b": ""},
        derivatives={"a": "w - k1 * u * a", "b": "k1 * u * a - k2 * b * v"},
        parameters={"k1": "0.7 1/s", "k2": "0.4 1/s"},
        inputs={"u": "", "v": "", "w": "1/s"},
        outputs={"a": "a", "b": "b"},
        substeps=2,
    )
    space: dict[str, Any] = {"duration": 4.0, "samples": samples, "runs": 2, "signals": signals}
    return oed.Problem(
        model=system,
        design=oed.SignalSpace(**{**space, "start_bounds": ((0.2, 1.0), (0.1, 0.1)), **parts}),
        measurement=oed.Outputs(noise={"a": 0.1, "b": 0.1}),
        limits=[oed.InputRange(input=name, range=pair) for name, pair in RANGES.items()],
        criterion=D(scaling="none"),
    )


def weights_of(terms: Terms) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    return rng.normal(size=terms.entry_count), rng.normal(size=sum(len(one.lower) for one in terms.rows))


def dense(matrix: ca.DM) -> np.ndarray:
    return np.array(ca.DM(matrix))


def same_as_whole(problem: oed.Problem, linear: list[bool]) -> None:
    """The terms are those of the drive written out; which limits are linear in the unknowns."""
    condensed, whole = Terms(problem), WrittenOut(problem)
    assert condensed.linear == whole.linear == linear
    for one, other in zip(condensed.rows, whole.rows, strict=True):
        np.testing.assert_array_equal(one.lower, other.lower)
        np.testing.assert_array_equal(one.upper, other.upper)
    z = np.random.default_rng(1).uniform(0.1, 1.0, whole.size)
    functions = called(condensed), whole.functions()
    for name in ("values", "jacobian"):
        for one, other in zip(*(getattr(part, name)(z) for part in functions), strict=True):
            other = dense(other)
            np.testing.assert_allclose(np.reshape(one, other.shape), other, rtol=1e-9, atol=1e-11)
    found, expected = (part.hessian(z, *weights_of(condensed)) for part in functions)
    np.testing.assert_allclose(dense(found), dense(expected), rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("start", ["chosen", "fixed"])
@pytest.mark.slow
def test_condensed_runs_that_share_every_input_are_the_whole_drive(start: str):
    shared = (PiecewiseLinear(pieces=3, shared=True), *2 * (Constant(shared=True),))
    bounds = ((0.2, 1.0 if start == "chosen" else 0.2), (0.1, 0.1))
    problem = problem_of(shared, samples=8, start_bounds=bounds)
    terms = Terms(problem)
    # Three inputs of 4, 1 and 1 unknowns, and of both runs the one state that is chosen.
    assert terms.size == (8 if start == "chosen" else 6)
    same_as_whole(problem, [True] * 3)


@pytest.mark.slow
def test_condensed_drives_without_inputs_are_the_whole_drive():
    system = oed.Equations(
        states={"a": "", "b": ""},
        derivatives={"a": "-k1 * a", "b": "k1 * a - k2 * b / (1 + b)"},
        parameters={"k1": "0.7 1/s", "k2": "0.4 1/s"},
        inputs={},
        outputs={"b": "b"},
    )
    bounds = ((0.2, 1.0), (0.1, 0.3))
    problem = oed.Problem(
        model=system,
        design=oed.SignalSpace(duration=4.0, samples=8, runs=2, signals=(), start_bounds=bounds),
        measurement=oed.Outputs(noise={"b": 0.1}),
        limits=[],
        criterion=D(scaling="none"),
    )
    same_as_whole(problem, [])


@pytest.mark.parametrize("signals", MIXED, ids=["steps", "smooth"])
class TestTermsOfSignals:
    @pytest.mark.slow
    def test_condensed_it_is_the_whole_drive(self, signals: tuple[Signal, ...]):
        # Those of known starts are compared with further limits, below.
        problem = problem_of(signals, samples=6)
        unknown = oed.Outputs(noise={"a": 0.1, "b": 0.1}, every=2, start="unknown")
        problem = replace(problem, measurement=unknown, estimate=("k1", "k2"))
        same_as_whole(problem, [True] * 3)

    @pytest.mark.slow
    def test_derivatives_are_those_of_differences(self, signals: tuple[Signal, ...]):
        terms = Terms(problem_of(signals))
        z = np.random.default_rng(1).uniform(0.1, 1.0, terms.size)
        (entries, rows), functions = weights_of(terms), called(terms)

        def gradient(at: np.ndarray) -> np.ndarray:
            by_entries, by_rows = functions.jacobian(at)
            return by_entries.T @ entries + by_rows.T @ rows

        def weighted(at: np.ndarray) -> float:
            own, stacked = functions.values(at)
            return float(own @ entries + stacked @ rows)

        steps = 1e-5 * np.eye(terms.size)
        slopes = [(weighted(z + step) - weighted(z - step)) / 2e-5 for step in steps]
        np.testing.assert_allclose(gradient(z), slopes, rtol=1e-6, atol=1e-5)
        bent = [(gradient(z + step) - gradient(z - step)) / 2e-5 for step in steps]
        curvature = dense(ca.triu2symm(ca.sparsify(ca.DM(functions.hessian(z, entries, rows)))))
        np.testing.assert_allclose(curvature, np.array(bent), rtol=1e-6, atol=1e-4)

    def test_are_those_of_the_drive_as_scored(self, signals: tuple[Signal, ...]):
        problem = problem_of(signals)
        design = DesignExpressions(problem)
        (z,) = random_drives(design, np.array([0.7]), np.random.default_rng(0))
        drive = design.trajectory(z)
        ((matrix,),) = design.matrices_of(z)
        (scored,) = score(problem, drive).information.values()
        np.testing.assert_allclose(matrix, scored, rtol=1e-8)
        np.testing.assert_allclose(design.unknowns_of(drive), z, atol=1e-12)

    def test_random_drives_keep_the_ranges(self, signals: tuple[Signal, ...]):
        problem = problem_of(signals)
        design = DesignExpressions(problem)
        rng = np.random.default_rng(0)
        assert random_drives(design, np.ones(0), rng).shape == (0, design.terms.size)
        drawn = random_drives(design, np.ones(50), rng)
        drawn = np.vstack([drawn, [perturbed_design(design, one, rng) for one in drawn]])
        first = design.terms.coefficient_count
        assert np.abs(drawn[:, first:]).max() <= 1
        for z in drawn[:50]:
            low, high = problem.input_bounds.T
            held = design.trajectory(z).inputs
            assert np.all((held >= low - 1e-12) & (held <= high + 1e-12))


@pytest.mark.slow
def test_rows_that_repeat_are_bounds_of_one_unknown():
    terms = Terms(problem_of())
    # Of two runs: five values each, a constant each, and what a wave is at 24 times.
    assert [len(one.lower) for one in terms.rows] == [10, 2, 48]
    rows, unknowns, _, _ = terms.bounded_unknowns
    np.testing.assert_array_equal(rows, np.arange(12))
    np.testing.assert_array_equal(unknowns, np.arange(12))
    (low, high), (least, _) = Frame(terms, relaxing=False).bounds(np.zeros(3))
    np.testing.assert_allclose(low[:12], [*[0.25] * 10, 0.1, 0.1])
    np.testing.assert_allclose(high[:12], 1.0)
    assert len(least) == 48


def test_chosen_starts_are_bounds_of_unknowns():
    problem = problem_of()
    design = DesignExpressions(problem)
    assert design.terms.size == design.terms.coefficient_count + 2
    (low, high), _ = Frame(design.terms, relaxing=False).bounds(np.zeros(3))
    np.testing.assert_array_equal(low[-2:], [-1.0, -1.0])
    np.testing.assert_array_equal(high[-2:], [1.0, 1.0])
    np.testing.assert_array_equal(start_bounds(design), [[-1.0, 1.0]] * 2)


@pytest.mark.parametrize("signals", MIXED, ids=["steps", "smooth"])
@pytest.mark.slow
def test_solved_by_ipopt_and_by_the_genetic_algorithm(signals: tuple[Signal, ...]):
    problem = problem_of(signals, samples=8)
    ipopt = oed.Ipopt(starts=1, perturbations=0, second_stage="none")
    best = oed.solve(problem, ipopt, seed=0, workers=1)
    assert best.status is oed.Status.CONVERGED
    genetic = oed.Genetic(population=40, generations=40)
    near = oed.solve(problem, genetic, seed=0, workers=1)
    for found in (best, near):
        assert found.evaluation.feasible
        starts = found.trajectory.starts
        assert np.all((starts[:, 0] >= 0.2) & (starts[:, 0] <= 1.0))
        np.testing.assert_array_equal(starts[:, 1], 0.1)
        # What was found is of the space.
        DesignExpressions(problem).unknowns_of(found.trajectory)
    assert near.evaluation.objective < best.evaluation.objective < near.evaluation.objective + 0.5


def at_most(expression: Any, bound: float, unit: str) -> Rows:
    count = expression.shape[0]
    return Rows(expression, np.full(count, -bound), np.full(count, bound), bound, unit)


class Slew(Limit):
    """On how fast the first two inputs change."""

    name: ClassVar[str] = "slew"
    looks_at: ClassVar = "inputs"

    def rows(self, drive: Drive) -> Rows:
        return at_most(ca.vec(drive.input_rates[:, :2]), 0.9, "1/s")


class Jolt(Limit):
    """On how fast the rate of the first changes."""

    name: ClassVar[str] = "jolt"
    looks_at: ClassVar = "inputs"

    def rows(self, drive: Drive) -> Rows:
        return at_most(drive.input_jerks[:, 0], 5.0, "1/s^2")


class Together(Limit):
    """On two inputs at one time."""

    name: ClassVar[str] = "together"
    looks_at: ClassVar = "inputs"

    def rows(self, drive: Drive) -> Rows:
        return at_most(drive.input_values[:, 0] + drive.input_values[:, 1], 2.2, "")


class Total(Limit):
    """Of whole runs, of inputs and states."""

    name: ClassVar[str] = "total"
    looks_at: ClassVar = "run"

    def rows(self, drive: Drive) -> Rows:
        _, last = drive.ends_of(drive.states)
        return at_most(ca.vertcat(ca.sumsqr(drive.inputs) / drive.samples, last[:, 1] ** 2), 6.0, "")


FURTHER = (Slew(), Jolt(), Together(), Total())


class TestFurtherLimits:
    @pytest.mark.parametrize("signals", MIXED, ids=["steps", "smooth"])
    @pytest.mark.slow
    def test_condensed_it_is_the_whole_drive(self, signals: tuple[Signal, ...]):
        problem = problem_of(signals, samples=6)
        problem = replace(problem, limits=(*problem.limits, *FURTHER))
        same_as_whole(problem, [*[True] * 6, False])

    def test_every_change_is_limited_once(self):
        problem = replace(problem_of(), limits=(*problem_of().limits, *FURTHER))
        rows = {
            limit.name: len(one.lower) for limit, one in zip(problem.limits, Terms(problem).rows, strict=True)
        }
        # Between five pieces of two runs there are four steps each; of each the jerk rises and falls.
        assert (rows["slew"], rows["jolt"], rows["together"]) == (8, 16, 10)

    @pytest.mark.slow
    @pytest.mark.parametrize("signals", MIXED, ids=["steps", "smooth"])
    def test_are_those_of_the_drive_as_scored(self, signals: tuple[Signal, ...]):
        problem = problem_of(signals)
        problem = replace(problem, limits=(*problem.limits, *FURTHER))
        design = DesignExpressions(problem)
        candidates = random_drives(design, np.ones(5), np.random.default_rng(0))
        candidates[:, : design.terms.coefficient_count] *= 1.5
        violations = np.maximum(0.0, design.score_many(candidates)[1])
        for z, own in zip(candidates, violations, strict=True):
            margins = {one.name: one for one in oed.evaluate(problem, design.trajectory(z)).margins}
            shares = [margins[limit.name].violation / margins[limit.name].size for limit in problem.limits]
            np.testing.assert_allclose(own, shares, rtol=1e-8, atol=1e-9)
        assert np.all(violations.max(axis=0)[:5] > 0.01)

    @pytest.mark.slow
    def test_a_design_keeps_them(self):
        problem = problem_of(samples=8)
        problem = replace(problem, limits=(*problem.limits, *FURTHER))
        ipopt = oed.Ipopt(starts=1, perturbations=0, second_stage="none")
        found = oed.solve(problem, ipopt, seed=0, workers=1)
        assert found.status is oed.Status.CONVERGED
        inputs, period = found.trajectory.inputs, problem.design.period
        changes = np.abs(np.diff(inputs.reshape(2, -1, 3), axis=1)).max(axis=(0, 1)) / period
        assert changes[0] <= 0.9 * (1 + 1e-6)
        assert changes[1] == 0


@pytest.mark.slow
def test_gains_are_those_of_wider_ranges():
    problem, ipopt = problem_of(samples=5), oed.Ipopt(starts=1, perturbations=0, second_stage="none")
    found = oed.solve(problem, ipopt, seed=0, workers=1)
    step = 1e-4
    # In steps and constants, whose ranges bound unknowns, and in waves, where they are rows.
    for place, name in enumerate(RANGES):
        low, high = problem.input_bounds[place]
        wider = [*problem.limits]
        unit = " 1/s" if name == "w" else ""
        wider[place] = oed.InputRange(input=name, range=(f"{low - step}{unit}", f"{high + step}{unit}"))
        more = oed.solve(replace(problem, limits=tuple(wider)), ipopt, seed=0, workers=1)
        gain = problem.objective.change(more.evaluation.objective, found.evaluation.objective, 2) / step
        assert found.gains[name] == pytest.approx(gain, rel=1e-2, abs=1e-4), name


def fishing(samples: int, pieces: int, **system: Any) -> oed.Problem:
    """Prey and predators that are fished, in steps [Lotka and Volterra; Sager, 2005]."""
    model = oed.Equations(
        states={"x": "", "y": ""},
        derivatives={"x": "a * x - b * x * y - 0.4 * x * u", "y": "c * x * y - d * y - 0.2 * y * u"},
        parameters={"a": "1 1/s", "b": "1 1/s", "c": "1 1/s", "d": "1 1/s"},
        inputs={"u": "1/s"},
        outputs={"x": "x", "y": "y"},
        **system,
    )
    return oed.Problem(
        model=model,
        design=oed.SignalSpace(
            duration=12, samples=samples, start=(0.5, 0.7), signals=(PiecewiseConstant(pieces=pieces),)
        ),
        measurement=oed.Outputs(noise={"x": 0.1, "y": 0.1}),
        limits=[oed.InputRange(input="u", range=("0 1/s", "1 1/s"))],
        criterion="D",
    )


@pytest.mark.slow
def test_steps_are_as_cheap_as_a_spline_of_degree_0():
    """The same drives by both descriptions: the same unknowns, operations and numbers."""
    problem = fishing(samples=30, pieces=6, substeps=1)
    spline = oed.Spline(degree=0, coefficients=6)
    usual = oed.SignalSpace(duration=12, samples=30, start=(0.5, 0.7), spline=spline, rest_to_rest=False)
    signals, splines = Terms(problem), Terms(replace(problem, design=usual))
    assert signals.written == splines.written
    z = np.random.default_rng(0).uniform(0, 1, 6)
    for name in ("values", "jacobian", "hessian"):
        given = [z, *weights_of(signals)] if name == "hessian" else [z]
        found, expected = (getattr(called(terms), name)(*given) for terms in (signals, splines))
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_a_coarse_grid_knows_chosen_starts():
    """Of one spline for all inputs: slopes of the information of all samples are those of differences."""
    spline = oed.Spline(degree=3, coefficients=6)
    parts = {"signals": (), "spline": spline, "rest_to_rest": False, "runs": 2}
    problem = problem_of(samples=96, **parts)
    grid = SearchGrid(problem, 24)
    assert grid.coarse
    (z,) = random_drives(grid.design, np.array([0.5]), np.random.default_rng(0))
    corrections = grid.correction(z)
    for step in 1e-5 * np.eye(len(z)):
        (found,), (fine,) = (
            np.subtract(*(matrices(z + sign * step) for sign in (1, -1)))
            for matrices in (
                lambda at: grid.matrices_of(at, corrections)[0],
                lambda at: DesignExpressions(problem).matrices_of(at)[0],
            )
        )
        np.testing.assert_allclose(found / 2e-5, fine / 2e-5, rtol=1e-6, atol=1e-6)
    assert not SearchGrid(problem_of(samples=96), 24).coarse


@pytest.mark.slow
def test_a_start_may_be_one_alone():
    found = oed.solve(problem_of(samples=8), oed.Ipopt(starts=1, perturbations=1), seed=0, workers=1)
    assert found.status is oed.Status.CONVERGED


@pytest.mark.slow
def test_many_steps_of_a_long_drive_need_little_memory():
    """Building the terms and a local search in a process of its own, whose largest memory is known."""
    script = (
        "import numpy as np\n"
        "from test_signal_problems import fishing\n"
        "from oed.optimize import Ipopt\nfrom oed.optimize.local import LocalSearch\n"
        "search = LocalSearch(fishing(120, 4, substeps=2), Ipopt(max_iterations=100))\n"
        "assert search.maximise(np.full(4, 0.4)).status.name == 'CONVERGED'\n"
        # Of this program alone: what a process has used before it became this one counts elsewhere.
        "text = open('/proc/self/status').read()\n"
        "print(next(line.split()[1] for line in text.splitlines() if line.startswith('VmHWM')))\n"
    )
    here = Path(__file__).parent
    folders = [str(here), str(here.parent), str(Path(oed.__file__).parent.parent)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    # Written out as a whole it would need some 300 MB.
    assert int(done.stdout) < 250e3


def test_drives_of_one_spline_are_as_they_were():
    """Free coefficients, input by input, in units of the largest speed; then the start poses."""
    space = DesignSpace(duration=4, samples=24, spline=oed.Spline(coefficients=6), runs=2, start="free")
    problem = robot_problem(design=space)
    design = DesignExpressions(problem)
    z = np.random.default_rng(0).normal(size=16 + 6)
    drive = design.trajectory(z)
    table = np.zeros((12, 2))
    table[[1, 2, 3, 4, 7, 8, 9, 10]] = z[:16].reshape(2, 8).T * np.abs(problem.input_bounds).max(axis=1)
    np.testing.assert_array_equal(drive.coefficients, table)
    np.testing.assert_array_equal(drive.starts, z[16:].reshape(2, 3))
    np.testing.assert_allclose(design.unknowns_of(drive), z, rtol=1e-15)


STILL = """
format: 1
name: A limit that the input does not move
system:
  kind: equations
  states: {x: 2}
  inputs: {u: ""}
  parameters: {k: 0.5 1/s, b: 1}
  derivatives: {x: k - k * x * x}
  outputs: {y: x + b * u}
experiment: {duration: 3 s, samples: 4, trials: 2, inputs: {u: [0, 1]}}
measurement: {kind: outputs, noise: {y: 0.1}}
limits: [{kind: end, name: ending, of: x * x, range: [0.5, 5]}]
estimate: [b]
criterion: D
"""


@pytest.mark.slow
def test_limits_that_no_input_moves_are_no_obstacle():
    """Their second derivatives are nothing at all, which was taken for zeros."""
    problem = oed.parse_study(STILL, "still.yaml").problem
    found = oed.solve(problem, oed.Ipopt(starts=1, perturbations=0, second_stage="none"), workers=1)
    assert found.evaluation.feasible
    # All readings as large as may be: five of each trial.
    assert found.evaluation.objective == pytest.approx(np.log(2 * 5 / 0.1**2), rel=1e-6)
