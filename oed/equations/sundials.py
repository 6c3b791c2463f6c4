"""States and their sensitivities by SUNDIALS, whatever a system's own integrator is."""

from __future__ import annotations

import casadi as ca
import numpy as np

from oed.equations.implicit import algebraic_solver, constraints_of, rates_of
from oed.equations.system import Equations
from oed.foundation.arrays import Array
from oed.foundation.errors import Failure
from oed.kernel.dynamics.rollout import any_drive
from oed.kernel.dynamics.trajectory import Trajectory

RELATIVE, ABSOLUTE = 1e-10, 1e-12
"""Tolerances; the absolute one of every quantity in units of its largest value in the drive."""
MOST_STEPS = 1_000_000
"""Of a period."""


def own_solution(system: Equations, trajectory: Trajectory) -> tuple[Array, Array]:
    """States (N + runs, states) and sensitivities (states, (N + runs) * (p + states)) by the system's own
    integrator, as a `Drive` has them.
    """
    symbols, drive = any_drive(system, trajectory.samples, trajectory.runs)
    function = ca.Function("drive", symbols, [drive.states, drive.sensitivities])
    found = function(trajectory.inputs, trajectory.starts, system.nominal, trajectory.period)
    states, sensitivities = map(np.array, found)
    return states, sensitivities


class Sundials:
    """The variational equations S' = f_x S + f_y Y + f_p, 0 = g_x S + g_y Y + g_p beside those of the states,
    by CVODES, or IDAS where there are algebraic states [Hindmarsh et al., SUNDIALS, 2005].

    Every quantity is integrated in units of its largest value in the system's own solution.

    Attributes:
        name: of the integrator.
    """

    def __init__(
        self, system: Equations, trajectory: Trajectory, states: Array, sensitivities: Array
    ) -> None:
        """Of a drive of a system.

        Args:
            system: that is driven.
            trajectory: the drive.
            states: by `own_solution`.
            sensitivities: alike.
        """
        self._system, self._trajectory = system, trajectory
        self._states, self._width = len(system.states), len(system.parameters) + len(system.states)
        self._algebraic = len(system.guesses)
        self.name = "IDAS" if self._algebraic else "CVODES"
        self._consistent = self._solved()
        rows = [row for run in np.split(np.arange(len(states)), trajectory.runs) for row in run[:-1]]
        each = sensitivities.reshape(self._states, -1, self._width, order="C")
        moving = np.hstack([states, each.transpose(1, 2, 0).reshape(len(states), -1)])
        following = self._consistent.map(len(rows))(
            moving[rows].T, np.vstack([trajectory.inputs.T, np.tile(system.nominal, (len(rows), 1)).T])
        )
        self._units = _largest(moving), _largest(np.array(following).T)
        self._integrator = self._made()

    def solution(self) -> tuple[Array, Array]:
        """States and sensitivities as `own_solution` has them.

        Raises:
            Failure: the integrator cannot go on.
        """
        found = list[Array]()
        trajectory, fixed = self._trajectory, self._system.nominal
        begin = np.hstack([np.zeros((self._states, len(fixed))), np.eye(self._states)])
        for start, inputs in zip(
            trajectory.starts, np.split(trajectory.inputs, trajectory.runs), strict=True
        ):
            now = np.concatenate([start, begin.ravel(order="F")])
            found.append(now)
            for held in inputs:
                now = self._period(now, np.concatenate([held, fixed]))
                found.append(now)
        table = np.array(found)
        slopes = table[:, self._states :].reshape(len(table), self._width, self._states)
        return table[:, : self._states], np.hstack([one.T for one in slopes])

    def _period(self, now: Array, given: Array) -> Array:
        moving, following = self._units
        guess = np.array(self._consistent(now, given)).ravel()
        try:
            found = self._integrator(x0=now / moving, z0=guess / following, p=given)
        except RuntimeError as error:
            raise Failure(f"{self.name} cannot follow the system along this drive") from error
        return np.asarray(np.array(found["xf"]).ravel() * moving)

    def _solved(self) -> ca.Function:
        # Algebraic states and their derivatives, of (states and S, inputs and parameters).
        moving, given, inputs = self._symbols()
        state, slopes = self._split(moving, self._states)
        parameters = given[inputs:]
        found = algebraic_solver(self._system)(state, given[:inputs], parameters)
        direct = ca.horzcat(ca.jacobian(found, parameters), ca.SX(self._algebraic, self._states))
        carried = ca.jacobian(found, state) @ slopes + direct
        return ca.Function("consistent", [moving, given], [ca.densify(ca.vertcat(found, ca.vec(carried)))])

    def _made(self) -> ca.Function:
        moving, given, inputs = self._symbols()
        following = ca.SX.sym("following", self._algebraic * (1 + self._width))
        units, further = map(ca.DM, self._units)
        state, slopes = self._split(units * moving, self._states)
        algebraic, more = self._split(further * following, self._algebraic)
        x, y = ca.SX.sym("x", self._states), ca.SX.sym("y", self._algebraic)
        results = []
        for function, rows in ((rates_of(self._system), units), (constraints_of(self._system), None)):
            value = function(x, y, given)
            direct = ca.jacobian(value, given[inputs:])
            wide = ca.horzcat(direct, ca.SX(value.shape[0], self._states))
            varied = ca.jacobian(value, x) @ slopes + ca.jacobian(value, y) @ more + wide
            whole = ca.substitute(
                ca.vertcat(value, ca.vec(varied)), ca.vertcat(x, y), ca.vertcat(state, algebraic)
            )
            results.append(ca.densify(whole) if rows is None else ca.densify(whole) / rows)
        dae = {"x": moving, "z": following, "p": given, "ode": results[0], "alg": results[1]}
        options = {"reltol": RELATIVE, "abstol": ABSOLUTE, "max_num_steps": MOST_STEPS}
        options |= {"disable_internal_warnings": True}
        return ca.integrator("exact", self.name.lower(), dae, 0.0, self._trajectory.period, options)

    def _symbols(self) -> tuple[ca.SX, ca.SX, int]:
        inputs = len(self._system.inputs)
        moving = ca.SX.sym("moving", self._states * (1 + self._width))
        return moving, ca.SX.sym("given", inputs + len(self._system.parameters)), inputs

    def _split(self, column: ca.SX, count: int) -> tuple[ca.SX, ca.SX]:
        return column[:count], ca.reshape(column[count:], count, self._width)


def _largest(table: Array) -> Array:
    # Of every column; 1 where there is nothing.
    sizes = np.abs(table).max(axis=0, initial=0.0)
    return np.where(sizes > 0, sizes, 1.0)
