"""Limits on expressions of states, parameters and outputs: at all times, at the end, or of whole trials."""

from __future__ import annotations

from abc import ABC
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from oed.equations.dimensions import PLAIN, TIME, Dimension, quantity
from oed.equations.given import Quantity, Readable
from oed.equations.grammar import ExpressionError, parse
from oed.equations.limits import require_rising
from oed.foundation.errors import Issue
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System, stepper
from oed.kernel.limit import Limit, PathLimit, Rows
from oed.kernel.pace import pace_of
from oed.kernel.repetitions import repetitions_of

NODES = 8
"""Nodes of Gauss's rule in a period: exact to 1e-6 for squares of states that swing once in it."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z]\w*$")]


class ExpressionLimit(Limit):
    """An expression between two values.

    Attributes:
        name: of the limit.
        of: the expression, of the system's states, inputs, parameters and outputs.
    """

    name: Name  # type: ignore[misc]  # Of each limit its own.
    of: str

    @property
    def dimension(self) -> Dimension | None:
        """What the expression's is multiplied by before it is compared; nothing by default."""
        return None

    @property
    def sides(self) -> tuple[Quantity | None, Quantity | None]:
        """Least and largest value, with their units."""
        raise NotImplementedError

    @property
    def bounds(self) -> tuple[float, float]:
        """SI; infinite where a side is open."""
        low, high = self.sides
        least = -np.inf if low is None else quantity(low)[0]
        return least, np.inf if high is None else quantity(high)[0]

    @property
    def size(self) -> float:
        """The larger of the bounds, SI."""
        return max(abs(one) for one in self.bounds if np.isfinite(one)) or 1.0

    def issues(self, system: System, space: Space) -> list[Issue]:
        """An expression that is none, of unknown names or units that do not fit."""
        readable = _readable(system)
        if readable is None:
            return [Issue(("limits", self.name), "expressions are of systems with outputs")]
        try:
            own = parse(self.of).dimension(readable.dimensions) or PLAIN
        except ExpressionError as error:
            return [Issue(("limits", self.name, "of"), f"column {error.offset + 1}: {error.message}")]
        own = own if self.dimension is None else own * self.dimension
        wrong = [one for one in self.sides if one is not None and not quantity(one)[1].fits(own)]
        text = f"expected values {own.words}, got some {{}}"
        return [Issue(("limits", self.name), text.format(quantity(one)[1].words)) for one in wrong[:1]]

    def unit(self, system: System) -> str:
        """Of the bounds, SI."""
        side = next(one for one in self.sides if one is not None)
        return quantity(side)[1].text

    def values(self, drive: Drive, states: Expression, inputs: Expression) -> Expression:
        """The expression's values (n, 1).

        Args:
            drive: of the system.
            states: (n, states).
            inputs: (n, inputs).
        """
        function = _function(drive.system, self.of)
        found = function.map(states.shape[0])(states.T, inputs.T, drive.parameters)
        return ca.vec(found)

    def between(self, values: Expression, system: System) -> Rows:
        """Values between the bounds."""
        low, high = self.bounds
        count = values.shape[0]
        return Rows(values, np.full(count, low), np.full(count, high), self.size, self.unit(system))


class OfStates(ExpressionLimit, ABC):
    """An expression of states between two values.

    Attributes:
        range: least and largest value, with their units.
    """

    loosened: ClassVar[str] = "{name} {amount} looser"
    range: tuple[Quantity, Quantity]

    @property
    def sides(self) -> tuple[Quantity | None, Quantity | None]:
        """The range."""
        return self.range

    @model_validator(mode="after")
    def _rises(self) -> OfStates:
        require_rising(self.range, self.bounds)
        return self

    def issues(self, system: System, space: Space) -> list[Issue]:
        """Also an expression that depends on what is held, which jumps."""
        issues = super().issues(system, space)
        if issues or not system.states:
            text = "means nothing for a system without states: give its inputs their ranges"
            return issues or [Issue(("limits", self.name), text)]
        function = _function(system, self.of)
        if function.jac_sparsity(0, 1).nnz():
            return [Issue(("limits", self.name, "of"), "depends on inputs: give these their ranges instead")]
        return []


class Always(OfStates, PathLimit):
    """An expression of states between two values at all times."""

    kind: Literal["always"] = "always"
    looks_at: ClassVar[Literal["state"]] = "state"

    def rows(self, drive: Drive) -> Rows:
        """At every point of the course."""
        count = drive.path.shape[0]
        nothing = ca.DM.zeros(count, len(drive.system.inputs))
        return self.between(self.values(drive, drive.path, nothing), drive.system)

    def rows_at(self, path: Expression, system: System) -> Rows:
        """On points of a course, the parameters nominal."""
        function, count = _function(system, self.of), path.shape[0]
        nothing = ca.DM.zeros(len(system.inputs), count)
        found = function.map(count)(path.T, nothing, ca.repmat(ca.DM(system.nominal), 1, count))
        return self.between(ca.vec(found), system)

    def depends_on(self, system: System) -> frozenset[str]:
        """Names of the parameters that the expression itself has, beside states that follow from them."""
        places = _function(system, self.of).jac_sparsity(0, 2).get_triplet()[1]
        return frozenset(system.parameters[place].name for place in places)


class AtEnd(OfStates):
    """An expression of states between two values at the end of every trial."""

    kind: Literal["end"] = "end"
    looks_at: ClassVar[Any] = "run"

    def rows(self, drive: Drive) -> Rows:
        """One row of every trial."""
        _, last = drive.ends_of(drive.states)
        nothing = ca.DM.zeros(last.shape[0], len(drive.system.inputs))
        return self.between(self.values(drive, last, nothing), drive.system)


class Budget(ExpressionLimit):
    """What is spent: an expression's integral over time, of all trials together, at most so much.

    Of a system without states the sum over its settings. A budget of costs has them as rates. Settings and
    trials count as often as their weights say.

    Attributes:
        most: that may be spent, with its unit.
    """

    kind: Literal["budget"] = "budget"
    looks_at: ClassVar[Any] = "run"
    counts_trials: ClassVar[bool] = True
    most: Quantity

    @property
    def sides(self) -> tuple[Quantity | None, Quantity | None]:
        """No more than the most."""
        return None, self.most

    def issues(self, system: System, space: Space) -> list[Issue]:
        """An expression that is none, or a most in another unit than its integral."""
        timed = self if not system.states else _Timed(name=self.name, of=self.of, most=self.most)
        return super(Budget, timed).issues(system, space)

    def rows(self, drive: Drive) -> Rows:
        """One row: the integral by Gauss's rule over every period, its input held."""
        counts = repetitions_of(drive)
        if not drive.system.states:
            nothing = drive.states[drive.begins, :]
            total = ca.dot(counts, self.values(drive, nothing, drive.inputs))
            return self.between(total, drive.system)
        lengths = drive.period * pace_of(drive)
        begins, total = drive.states[drive.begins, :], 0.0
        swings = _function(drive.system, self.of).jac_sparsity(0, 0).nnz() > 0
        for node, weight in zip(*np.polynomial.legendre.leggauss(NODES if swings else 1), strict=True):
            states = begins
            if swings:
                step = stepper(drive.system).map(begins.shape[0])
                elapsed = (1 + node) / 2 * drive.period
                states = step(begins.T, drive.inputs.T, drive.parameters, elapsed).T
            total += weight / 2 * ca.dot(counts, self.values(drive, states, drive.inputs) * lengths)
        return self.between(total, drive.system)


class _Timed(Budget):
    """A budget of a system with states: its expression counts per second."""

    @property
    def dimension(self) -> Dimension | None:
        """Time."""
        return TIME


@lru_cache(maxsize=64)
def _function(system: System, text: str) -> ca.Function:
    # (state, inputs, parameters) -> value of the expression.
    own = _readable(system)
    assert own is not None
    state, parameters = ca.SX.sym("state", len(own.states)), ca.SX.sym("p", len(own.parameters))
    inputs = ca.SX.sym("inputs", len(system.inputs))
    values = own.values_at(state, inputs[: len(own.inputs)], parameters)
    found = ca.densify(ca.SX(parse(text).casadi(values)))
    return ca.Function("expression", [state, inputs, parameters], [found])


def _readable(system: System) -> Readable | None:
    # The system, or that inside of one with further inputs.
    own = getattr(system, "inner", system)
    return own if isinstance(own, Readable) else None


LIMITS: tuple[type[ExpressionLimit], ...] = (Always, AtEnd, Budget)
"""Every limit on expressions."""
