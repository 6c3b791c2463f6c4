"""How far a drive by a system's own integrator is from one by SUNDIALS: states, readings, information."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from oed.equations.outputs import OutputSensor
from oed.equations.sundials import Sundials, own_solution
from oed.equations.system import Equations
from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.errors import UserMistake
from oed.foundation.presenting import Card, Presented, given, number
from oed.foundation.text import significant
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.moment import moment_reading
from oed.kernel.measurement.sensor import sensor_labels
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.problem import Problem
from oed.kernel.scorer import score

FINER = 2
"""How many times finer Radau's steps are to the middles of periods, which SUNDIALS is not asked about. What a
system that takes them itself is off by is 32 times as much.
"""


@dataclass(frozen=True, repr=False)
class IntegrationError(Presented):
    """Differences between a drive by a system's own integrator and one by SUNDIALS.

    Attributes:
        integrator: by which the differences are known: "CVODES", or "IDAS" of systems with algebraic states.
        states: largest difference of each state over the samples, as a share of its largest magnitude.
        sensitivities: of each parameter the largest difference of a state's derivative, alike.
        outputs: of what is read, alike.
        readings: largest difference of a reading, in units of its noise.
        information: largest |F - F'|_ij / sqrt(F'_ii F'_jj) of the criterion's information.
        standard_errors: of each estimated parameter |sigma / sigma' - 1|.
        objective: the criterion's value by SUNDIALS, at the nominal parameters.
        own_objective: that by the system's own integrator.
    """

    integrator: str
    states: Mapping[str, float]
    sensitivities: Mapping[str, float]
    outputs: Mapping[str, float]
    readings: float
    information: float
    standard_errors: Mapping[str, float]
    objective: float
    own_objective: float

    @property
    def sentence(self) -> str:
        """How far the information is off, in words."""
        return f"the information differs by {significant(2)(self.information)} from that by {self.integrator}"

    def _card(self) -> Card:
        facts = given(
            ("states", _worst(self.states)),
            ("sensitivities", _worst(self.sensitivities)),
            ("outputs", _worst(self.outputs)),
            ("readings", f"{significant(2)(self.readings)} standard deviations"),
            ("standard errors", _worst(self.standard_errors)),
            (
                "objective",
                f"{number(self.own_objective, digits=7)}, by {self.integrator} "
                f"{number(self.objective, digits=7)}",
            ),
        )
        return Card(f"Integration: {self.sentence}", facts)


@typed
def validate_integration(problem: Problem, trajectory: Trajectory) -> IntegrationError:
    """How far the states, sensitivities, readings and information of a drive are off, by SUNDIALS at a
    relative tolerance of 1e-10.

    Raises:
        UserMistake: no system given by equations, or one without states.
        NotFinite: a drive that cannot be scored.
        Failure: SUNDIALS cannot follow the system.
    """
    system = problem.system
    if not isinstance(system, Equations) or not system.states:
        raise UserMistake("only systems given by equations that have states are integrated")
    score(problem, trajectory)
    states, sensitivities = own_solution(system, trajectory)
    sundials = Sundials(system, trajectory, states, sensitivities)
    own = _Judged.of(problem, system, trajectory, states, sensitivities)
    exact = _Judged.of(problem, system.by_radau(FINER), trajectory, *sundials.solution())
    pairs = list(zip(own.roots, exact.roots, strict=True))
    return IntegrationError(
        integrator=sundials.name,
        states=_shares(system.states, own.states, exact.states),
        sensitivities=_by_parameter(system, own, exact),
        outputs=_by_name(own.names, own.readings, exact.readings),
        readings=float(np.abs(own.readings - exact.readings).max()),
        information=max(_off(one.matrix, other.matrix) for one, other in pairs),
        standard_errors=own.departures(exact),
        objective=exact.objective,
        own_objective=own.objective,
    )


@dataclass(frozen=True)
class _Solved(Drive):
    """A drive whose sensitivities are known."""

    known: Expression | None = None

    @cached_property
    def sensitivities(self) -> Expression:
        return self.known


@dataclass(frozen=True)
class _Judged:
    """What is read of a solution, in units of the noise, and what it says.

    Attributes:
        states: (rows, states).
        sensitivities: (states, rows * columns).
        names: of the readings.
        readings: (M,).
        roots: of the information, as the criterion sees it.
        deviations: of the estimated parameters, by name.
        objective: the criterion's value.
    """

    states: Array
    sensitivities: Array
    names: Sequence[str]
    readings: Array
    roots: Sequence[SquareRoot]
    deviations: Mapping[str, float]
    objective: float

    @classmethod
    def of(
        cls, problem: Problem, system: Equations, trajectory: Trajectory, states: Array, sensitivities: Array
    ) -> _Judged:
        known = [ca.MX.sym("states", *states.shape), ca.MX.sym("S", *sensitivities.shape)]
        drive = roll_out(
            system,
            inputs=ca.MX(ca.DM(trajectory.inputs)),
            parameters=ca.MX(ca.DM(system.nominal)),
            period=ca.MX(trajectory.period),
            states=[one.T for one in ca.vertsplit(known[0], len(states) // trajectory.runs)],
            runs=trajectory.runs,
        )
        estimations = problem.estimations(_Solved(**vars(drive), known=known[1]))
        blocks = [one.block for one in estimations]
        expressions = [*(one.response for one in blocks), *(one.jacobian for one in blocks)]
        function = ca.Function("judged", known, [ca.densify(one) for one in expressions])
        found = [np.array(one) for one in function.call([states, sensitivities])]
        responses, jacobians = found[: len(blocks)], found[len(blocks) :]
        each = zip(estimations, jacobians, strict=True)
        pairs = [one.square_roots(own, np.zeros(len(one.block.parameters))) for one, own in each]
        deviations = {
            name: float(size)
            for one, (_, full) in zip(estimations, pairs, strict=True)
            for name, size in zip(one.parameters, np.sqrt(np.diag(full.covariance)), strict=True)
        }
        roots = [seen for seen, _ in pairs]
        readings, objective = np.concatenate(responses).ravel(), float(problem.objective.judge(roots))
        names = _names(problem, system, trajectory)
        return cls(states, sensitivities, names, readings, roots, deviations, objective)

    def departures(self, exact: _Judged) -> dict[str, float]:
        """Of the standard deviations, as shares."""
        return {
            name: abs(own / exact.deviations[name] - 1)
            for name, own in self.deviations.items()
            if np.isfinite(own) and np.isfinite(exact.deviations[name])
        }


def _names(problem: Problem, system: Equations, trajectory: Trajectory) -> list[str]:
    # What every reading is of, in their order.
    found = list[str]()
    sensors = problem.measurement.joint_sensors
    for sensor, label in zip(sensors, sensor_labels(sensors), strict=True):
        times = trajectory.runs * len(sensor.columns(trajectory.samples // trajectory.runs))
        own = [label] * int(moment_reading(sensor, system).size1_out(0))
        found += [*(sensor.names if isinstance(sensor, OutputSensor) else own)] * times
    return found


def _by_name(names: Sequence[str], own: Array, exact: Array) -> dict[str, float]:
    places = {name: np.array([other == name for other in names]) for name in dict.fromkeys(names)}
    return {name: _share(own[at], exact[at]) for name, at in places.items()}


def _by_parameter(system: Equations, own: _Judged, exact: _Judged) -> dict[str, float]:
    names, states = [one.name for one in system.parameters], len(system.states)
    tables = [one.sensitivities.reshape(states, -1, len(names) + states) for one in (own, exact)]
    return {
        name: max(_share(*(table[state, :, place] for table in tables)) for state in range(states))
        for place, name in enumerate(names)
    }


def _shares(names: Sequence[str], own: Array, exact: Array) -> dict[str, float]:
    return {name: _share(one, other) for name, one, other in zip(names, own.T, exact.T, strict=True)}


def _share(own: Array, exact: Array) -> float:
    # Of the largest magnitude; of what is 0 there is none.
    size = float(np.abs(exact).max())
    return float(np.abs(own - exact).max()) / size if size else 0.0


def _off(own: Array, exact: Array) -> float:
    sizes = np.sqrt(np.diag(exact))
    units = np.outer(sizes, sizes)
    return float((np.abs(own - exact) / np.where(units > 0, units, 1.0)).max())


def _worst(shares: Mapping[str, float]) -> str:
    name = max(shares, key=lambda one: shares[one], default="")
    return f"{significant(2)(shares[name])} ({name})" if name else ""
