"""Limits on expressions of states, parameters and outputs: at all times, at the end, or of all trials."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from oed.equations.dimensions import PLAIN, TIME, Dimension, Quantity
from oed.equations.grammar import parse
from oed.equations.issues import Issues
from oed.equations.limits import QuantityLimit, Range
from oed.equations.output_system import OutputSystem
from oed.foundation.errors import Issue
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System, stepper
from oed.kernel.limit import PathLimit, Rows
from oed.kernel.pace import pace_of
from oed.kernel.repetitions import repetitions_of

NODES = 8
"""Nodes of Gauss's rule in a period: exact to 1e-6 for squares of states that swing once in it."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z]\w*$")]


class ExpressionLimit(QuantityLimit):
    """A limit on an expression.

    Attributes:
        name: name of the limit.
        of: expression of the system's states, inputs, parameters and outputs.
    """

    name: Name  # type: ignore[misc]  # Of each limit its own.
    of: str

    def issues(self, system: System, space: Space) -> list[Issue]:
        """Refuse a text that is no expression, unknown names, or units that do not fit."""
        issues, readable = Issues("limits", self.name), _readable(system)
        if readable is None:
            issues.add("expressions are of systems with outputs")
            return issues
        dimension = PLAIN
        with issues.at("of"):
            dimension = parse(self.of).dimension(readable.dimensions) or PLAIN
        return issues or self.unit_issues(dimension * self.times(system), "values")

    def times(self, system: System) -> Dimension:
        """Return the dimension that the expression's is multiplied by before it is compared."""
        return PLAIN

    def values(
        self, system: System, states: Expression, parameters: Expression, inputs: Expression | None = None
    ) -> Expression:
        """Return the expression's values (n, 1).

        Args:
            system: the system.
            states: states, (n, states).
            parameters: parameters, (p, 1).
            inputs: inputs, (n, inputs); 0 by default.
        """
        count = states.shape[0]
        if inputs is None:
            inputs = ca.DM.zeros(count, len(system.inputs))
        return ca.vec(_function(system, self.of).map(count)(states.T, inputs.T, parameters))


class StateLimit(ExpressionLimit):
    """A limit on an expression of states.

    Attributes:
        range: least and largest value, with their units.
    """

    loosened: ClassVar[str] = "{name} {amount} looser"
    range: Range

    @property
    def sides(self) -> tuple[Quantity, Quantity]:
        """Least and largest value, with their units."""
        return self.range

    def issues(self, system: System, space: Space) -> list[Issue]:
        """Refuse also an expression that depends on inputs, which jump."""
        issues = super().issues(system, space)
        if not issues and not system.states:
            text = "means nothing for a system without states: give its inputs their ranges"
            return [Issue(("limits", self.name), text)]
        if not issues and _function(system, self.of).jac_sparsity(0, 1).nnz():
            return [Issue(("limits", self.name, "of"), "depends on inputs: give these their ranges instead")]
        return issues


class Always(StateLimit, PathLimit):
    """An expression of states between two values at all times."""

    kind: Literal["always"] = "always"
    looks_at: ClassVar[Literal["state"]] = "state"

    def rows(self, drive: Drive) -> Rows:
        """Keep the expression between the bounds at every point of the path."""
        return self.between(self.values(drive.system, drive.path, drive.parameters))

    def rows_at(self, path: Expression, system: System) -> Rows:
        """Keep the expression between the bounds on points of a path, the parameters nominal."""
        return self.between(self.values(system, path, ca.DM(system.nominal)))

    def depends_on(self, system: System) -> frozenset[str]:
        """Return the parameters that the expression names, besides those that its states depend on."""
        places = _function(system, self.of).jac_sparsity(0, 2).get_triplet()[1]
        return frozenset(system.parameters[place].name for place in places)


class AtEnd(StateLimit):
    """An expression of states between two values at the end of every trial."""

    kind: Literal["end"] = "end"
    looks_at: ClassVar[Any] = "run"

    def rows(self, drive: Drive) -> Rows:
        """Keep the expression between the bounds in the last state of every trial."""
        _, last = drive.ends_of(drive.states)
        return self.between(self.values(drive.system, last, drive.parameters))


class IntegralBudget(ExpressionLimit):
    """An upper bound on an expression's integral over time, of all trials together.

    Without states it bounds the sum over the settings. Costs are given as rates. Settings and trials count as
    often as their weights say.

    Attributes:
        most: upper bound, with its unit.
    """

    kind: Literal["budget"] = "budget"
    looks_at: ClassVar[Any] = "run"
    counts_trials: ClassVar[bool] = True
    most: Quantity

    @property
    def sides(self) -> tuple[None, Quantity]:
        """No lower bound, and the upper one with its unit."""
        return None, self.most

    def times(self, system: System) -> Dimension:
        """Return the dimension that an integral over time multiplies by."""
        return TIME if system.states else PLAIN

    def rows(self, drive: Drive) -> Rows:
        """Bound the integral, by Gauss's rule over every period with its inputs held."""
        counts, system = repetitions_of(drive), drive.system
        begins, total = drive.states[drive.begins, :], 0.0
        lengths = drive.period * pace_of(drive) if system.states else 1.0
        swings = _function(system, self.of).jac_sparsity(0, 0).nnz() > 0
        for node, weight in zip(*np.polynomial.legendre.leggauss(NODES if swings else 1), strict=True):
            states = begins
            if swings:
                step = stepper(system).map(begins.shape[0])
                states = step(begins.T, drive.inputs.T, drive.parameters, (1 + node) / 2 * drive.period).T
            values = self.values(system, states, drive.parameters, drive.inputs)
            total += weight / 2 * ca.dot(counts, values * lengths)
        return self.between(total)


@lru_cache(maxsize=64)
def _function(system: System, text: str) -> ca.Function:
    # (state, inputs, parameters) -> value of the expression.
    readable = _readable(system)
    assert readable is not None
    state, parameters = ca.SX.sym("state", len(readable.states)), ca.SX.sym("p", len(readable.parameters))
    inputs = ca.SX.sym("inputs", len(system.inputs))
    values = readable.values_at(state, inputs[: len(readable.inputs), :], parameters)
    value = ca.densify(ca.SX(parse(text).casadi(values)))
    return ca.Function("expression", [state, inputs, parameters], [value])


def _readable(system: System) -> OutputSystem | None:
    # The system, or the one inside of it where further inputs are added.
    inner = getattr(system, "inner", system)
    return inner if isinstance(inner, OutputSystem) else None


LIMITS: tuple[type[ExpressionLimit], ...] = (Always, AtEnd, IntegralBudget)
"""All limits on expressions."""
