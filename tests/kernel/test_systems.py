"""Systems that are no robots, from design to score: the kernel asks for inputs, parameters and a step.

A first-order lag, y' = (gain u - y) / tau: known exactly, and the textbook's first example.
"""

from __future__ import annotations

import re
from math import exp
from pathlib import Path
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import pytest
from written_out import WrittenOut, called

import oed
from oed.foundation.errors import ProblemError, UserMistake
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import InputLimit, PathLimit, Rows
from oed.optimize.exchange import ENOUGH
from oed.optimize.terms import terms_of
from tests.oracle import central_difference

GAIN, TAU, NOISE = 2.0, 0.8, 0.05
DURATION, SAMPLES = 4.0, 40


class Lag(oed.System):
    inputs: ClassVar[tuple[oed.Input, ...]] = (oed.Input("voltage", "voltage", "V"),)
    states: ClassVar[tuple[str, ...]] = ("level",)
    state_units: ClassVar[tuple[str, ...]] = ("m",)

    @property
    def parameters(self) -> tuple[oed.Parameter, ...]:
        return (oed.Parameter("gain", GAIN, "m/V"), oed.Parameter("tau", TAU, "s"))

    def step(self, state, inputs, parameters, period):
        decay = ca.exp(-period / parameters[1])
        return decay * state + (1 - decay) * parameters[0] * inputs


class Level(oed.Sensor):
    """The level at every sample; where it began is known, or a nuisance."""

    kind: Literal["level"] = "level"
    noise: float = NOISE
    begun: Literal["known", "unknown"] = "known"

    @property
    def start_known(self) -> Literal["known", "unknown"]:
        return self.begun

    def reading(self, moment: oed.Moment):
        return moment.state[0]

    def whitening(self, moment: oed.Moment):
        return ca.SX(1 / self.noise)


class Voltage(InputLimit):
    name: ClassVar[str] = "voltage"
    quantity: ClassVar[str] = "voltage"
    unit: ClassVar[str] = "V"

    def rows(self, drive: Drive) -> Rows:
        return self.bounded(drive.input_values, drive.system)

    def input_bounds(self, system: oed.System) -> dict[str, tuple[float, float]]:
        return self.bounds_by_name(system)


class Brim(PathLimit):
    """The level stays below the brim."""

    name: ClassVar[str] = "brim"
    height: float

    def rows_at(self, path, system: oed.System) -> Rows:
        count = path.shape[0]
        return Rows(path[:, 0], np.full(count, -np.inf), np.full(count, self.height), self.height, "m")


def space(**keys) -> oed.SignalSpace:
    usual = {"duration": DURATION, "samples": SAMPLES, "spline": oed.Spline(degree=1, coefficients=9)}
    return oed.SignalSpace(**{**usual, "rest_to_rest": False, **keys})


def lag_problem(**parts) -> oed.Problem:
    usual = {
        "model": Lag(),
        "design": space(),
        "measurement": Level(),
        "limits": (Voltage(bounds=(0.0, 1.0)),),
        "criterion": oed.D(),
    }
    return oed.Problem(**{**usual, **parts})


def levels(parameters: np.ndarray, inputs: np.ndarray, start: float = 0.0) -> np.ndarray:
    """The lag's readings, in plain NumPy."""
    gain, tau = parameters
    decay = exp(-DURATION / SAMPLES / tau)
    found = [start]
    for held in inputs:
        found.append(decay * found[-1] + (1 - decay) * gain * held)
    return np.array(found)


def plain_information(drive: oed.Trajectory, start: float = 0.0) -> np.ndarray:
    nominal = np.array([GAIN, TAU])
    slopes = central_difference(lambda values: levels(values, drive.inputs[:, 0], start), nominal, 1e-6)
    slopes = np.asarray(slopes) * nominal / NOISE
    return slopes.T @ slopes


def a_drive(problem: oed.Problem, seed: int = 0) -> oed.Trajectory:
    rng = np.random.default_rng(seed)
    return problem.design.trajectory(rng.uniform(0, 1, (9, 1)), problem.fixed_starts)


class TestLag:
    def test_information_is_that_of_differences(self):
        problem = lag_problem()
        drive = a_drive(problem)
        found = oed.evaluate(problem, drive)
        assert found.objective == pytest.approx(np.linalg.slogdet(plain_information(drive))[1], abs=1e-6)
        assert found.feasible
        assert found.path_length == 0

    def test_it_starts_where_the_space_says(self):
        problem = lag_problem(design=space(start=(0.7,)))
        drive = a_drive(problem)
        found = oed.evaluate(problem, drive)
        assert found.objective == pytest.approx(np.linalg.slogdet(plain_information(drive, 0.7))[1], abs=1e-6)

    def test_a_start_that_is_not_known_is_a_nuisance(self):
        problem = lag_problem(measurement=Level(begun="unknown"))
        assert [one.name for one in problem.any_estimations[0].block.nuisances] == ["start.level"]
        known = oed.evaluate(lag_problem(), a_drive(problem)).objective
        assert oed.evaluate(problem, a_drive(problem)).objective < known

    @pytest.mark.slow
    def test_a_design_beats_every_step_and_pulse(self):
        problem = lag_problem()
        found = oed.solve(problem, oed.Ipopt(starts=4, perturbations=0), seed=0)
        assert found.status.usable
        assert found.evaluation.feasible
        own = oed.evaluate(problem, found.trajectory).objective
        assert own == found.evaluation.objective
        ramps = [np.r_[np.zeros(k), np.ones(9 - k)] for k in range(9)]
        pulses = [np.r_[np.ones(k), np.zeros(9 - k)] for k in range(1, 9)]
        for shape in (*ramps, *pulses):
            drive = problem.design.trajectory(shape[:, None], problem.fixed_starts)
            assert own >= oed.evaluate(problem, drive).objective - 1e-6

    @pytest.mark.slow
    @pytest.mark.parametrize(
        "solver", [oed.Ipopt(starts=1, perturbations=0), oed.Genetic(population=20, generations=10)]
    )
    def test_limits_on_states_hold_at_all_times(self, solver):
        problem = lag_problem(limits=(Voltage(bounds=(0.0, 1.0)), Brim(height=1.2)))
        found = oed.solve(problem, solver, seed=0)
        assert found.evaluation.feasible
        margin = next(one for one in found.evaluation.margins if one.name == "brim")
        assert margin.certain
        assert found.evaluation.states[:, 0].max() <= 1.2 * (1 + ENOUGH)

    @pytest.mark.slow
    def test_its_start_may_be_chosen(self):
        problem = lag_problem(design=space(start="free"))
        # One search from a perturbed copy of the best design shows that a start is perturbed, too.
        found = oed.solve(problem, oed.Ipopt(starts=1, perturbations=1, max_iterations=30), seed=0)
        fixed = oed.solve(lag_problem(), oed.Ipopt(starts=1, perturbations=0), seed=0)
        assert found.trajectory.starts.shape == (1, 1)
        assert found.evaluation.objective >= fixed.evaluation.objective - 1e-6

    @pytest.mark.slow
    def test_several_runs(self):
        problem = lag_problem(design=space(runs=2, start=((0.0,), (1.0,))))
        found = oed.solve(problem, oed.Ipopt(starts=1, perturbations=0), seed=0)
        assert found.trajectory.starts.tolist() == [[0.0], [1.0]]
        assert found.evaluation.feasible

    def test_its_parameters_are_what_it_is_known_by(self):
        with pytest.raises(
            ProblemError, match=r"expected some of the system's parameters \(gain, tau\), got mass"
        ):
            lag_problem(estimate=("mass",))

    def test_an_input_that_nothing_bounds(self):
        with pytest.raises(ProblemError, match="nothing bounds voltage; add a limit on voltage"):
            lag_problem(limits=())

    def test_limits_of_robots_are_for_robots(self):
        room = oed.Rectangle(x=(-1, 1), y=(-1, 1))
        with pytest.raises((ProblemError, UserMistake), match="Lag is no robot"):
            lag_problem(limits=(Voltage(bounds=(0.0, 1.0)), room))

    def test_predictions_are_of_its_states(self):
        leg = {"inputs": [1.0], "duration": 2.0}
        problem = lag_problem(criterion=oed.G(test_drive=[leg], quantity="level"))
        drive = a_drive(problem)
        slope = np.array([1 - exp(-2 / TAU), -GAIN * exp(-2 / TAU) * 2 / TAU**2]) * [GAIN, TAU]
        variance = slope @ np.linalg.solve(plain_information(drive), slope)
        assert oed.evaluate(problem, drive).objective == pytest.approx(-variance, rel=1e-5)
        with pytest.raises(ProblemError, match="expected one of level; got 'heading'"):
            lag_problem(criterion=oed.G(test_drive=[leg], quantity="heading"))

    @pytest.mark.slow
    def test_uncertain_lags_keep_to_the_brim(self):
        problem = lag_problem(
            limits=(Voltage(bounds=(0.0, 1.0)), Brim(height=1.2)),
            uncertainty=oed.Uncertainty(within={"gain": "10 %"}),
            robust=oed.Robust(draws=400),
        )
        found = oed.solve(problem, oed.Ipopt(starts=1, perturbations=0), seed=0)
        assert found.evaluation.feasible
        assert found.violation.probability <= 0.05

    def test_no_bound_is_claimed_of_what_the_bounds_do_not_know(self):
        certificate = oed.bound(lag_problem(criterion=oed.E()))
        assert certificate.upper_bound == np.inf


class Product(oed.System):
    """No states: an algebraic response."""

    inputs: ClassVar[tuple[oed.Input, ...]] = (oed.Input("voltage", "voltage", "V"),)

    @property
    def parameters(self) -> tuple[oed.Parameter, ...]:
        return (oed.Parameter("gain", GAIN, "m/V"), oed.Parameter("bend", 0.5, "m/V^2"))

    def step(self, state, inputs, parameters, period):
        return state

    def signals(self, state, inputs, parameters, period):
        return {"force": parameters[0] * inputs + parameters[1] * inputs**2}


class Force(Level):
    kind: Literal["force"] = "force"
    when: ClassVar[Literal["in periods"]] = "in periods"

    def reading(self, moment: oed.Moment):
        return moment.signals["force"]


@pytest.mark.slow
def test_a_response_without_states():
    problem = lag_problem(model=Product(), measurement=Force())
    drive = a_drive(problem)
    held = drive.inputs[:, 0]
    table = np.stack([held, held**2], axis=1) * [GAIN, 0.5] / NOISE
    expected = np.linalg.slogdet(table.T @ table)[1]
    assert oed.evaluate(problem, drive).objective == pytest.approx(expected, rel=1e-12)
    found = oed.solve(problem, oed.Ipopt(starts=2, perturbations=0), seed=0)
    assert found.evaluation.objective > expected


class Heat(oed.Limit):
    """On every period by itself, or on whole runs."""

    name: ClassVar[str] = "heat"
    whole: bool

    @property
    def looks_at(self) -> Literal["state", "run"]:
        return "run" if self.whole else "state"

    def rows(self, drive: Drive) -> Rows:
        squares = drive.inputs**2
        heat = ca.sum1(squares) if self.whole else squares
        count = heat.shape[0]
        return Rows(heat, np.full(count, -np.inf), np.full(count, 0.9), 0.9, "V^2")


@pytest.mark.slow
@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("when", ["at samples", "in periods"])
def test_it_is_condensed(when: str, whole: bool, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(Force, "when", when)
    limits = (Voltage(bounds=(0.0, 1.0)), Heat(whole=whole))
    problem = lag_problem(model=Product(), measurement=Force(), limits=limits, design=space(runs=2))
    condensed, written_out = terms_of(problem), WrittenOut(problem)
    rng, size = np.random.default_rng(0), sum(len(one.lower) for one in written_out.rows)
    z, weights = rng.uniform(0, 1, written_out.size), [rng.normal(size=3), rng.normal(size=size)]
    for name, given in (("values", [z]), ("jacobian", [z]), ("hessian", [z, *weights])):
        functions = called(condensed), written_out.functions()
        found, expected = (getattr(one, name)(*given) for one in functions)
        for own, other in zip(found, expected, strict=True) if name != "hessian" else [(found, expected)]:
            other = np.array(ca.densify(other))
            np.testing.assert_allclose(np.reshape(own, other.shape), other, rtol=1e-9, atol=1e-9)


KERNEL = Path(oed.__file__).parent / "kernel"
FOREIGN = {"heading", "wheel", "twist", "pose", "workspace"}


def test_the_kernel_speaks_of_systems():
    """Whole words of identifiers, split at underscores and capitals, and of prose; plurals too."""
    found = []
    for path in sorted(KERNEL.rglob("*.py")):
        text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", path.read_text()).replace("_", " ").lower()
        for word in re.findall(r"[a-z]+", text):
            if word in FOREIGN or word.removesuffix("s") in FOREIGN:
                found.append(f"{path.relative_to(KERNEL)}: {word}")
    assert not found
