"""Limits of drives: a limit is a name and rows lower <= expression <= upper."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import BeforeValidator, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from oed.foundation.arguments import WrongKind, kind_issue
from oed.foundation.arrays import ROUNDING, Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.presenting import Brief
from oed.foundation.quantities import counts_as_zero, parse_quantity
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.space import Space
from oed.kernel.dynamics.system import System, label_of

ROUNDED = 1e-3
"""Share of a magnitude's limit over which its corner at 0 is rounded."""


@dataclass(frozen=True, repr=False)
class Rows(Brief):
    """lower <= expression <= upper, row by row.

    Attributes:
        expression: (rows,).
        lower, upper: (rows,), in `unit`; infinite where one side is open.
        size: the limit's own size in `unit`, against which a violation is judged.
        unit: SI unit of the rows.
    """

    expression: Expression
    lower: Array
    upper: Array
    size: float
    unit: str

    def __post_init__(self) -> None:
        """Check that every row has its bounds.

        Raises:
            ValueError: bounds of another number of rows.
        """
        count = self.expression.numel()
        for name, bounds in (("lower", self.lower), ("upper", self.upper)):
            if np.shape(bounds) != (count,):
                text = f"rows: expected {count} of {name}, as of its expression, got {np.shape(bounds)}"
                raise ValueError(text)

    def widened(self, share: float) -> Rows:
        """Return the rows that allow an excess of `share` of the size."""
        spare = share * self.size
        return replace(self, lower=self.lower - spare, upper=self.upper + spare)

    def backed_off(self, amounts: Expression) -> Rows:
        """Return the rows `amounts` (rows,) away from their bounds: rows of the upper ones, then of the
        lower.
        """
        below, above = np.isfinite(self.lower), np.isfinite(self.upper)
        sides = [
            ca.vec(self.expression + sign * amounts)[np.flatnonzero(side).tolist()]
            for sign, side in ((1, above), (-1, below))
            if side.any()
        ]
        high, low = int(above.sum()), int(below.sum())
        return replace(
            self,
            expression=ca.vertcat(*sides),
            lower=np.concatenate([np.full(high, -np.inf), self.lower[below]]),
            upper=np.concatenate([self.upper[above], np.full(low, np.inf)]),
        )

    def joined(self, others: Sequence[Rows]) -> Rows:
        """Return the rows together with other rows of the same limit."""
        every = (self, *others)
        return replace(
            self,
            expression=ca.vertcat(*(rows.expression for rows in every)),
            lower=np.concatenate([rows.lower for rows in every]),
            upper=np.concatenate([rows.upper for rows in every]),
        )


def checked_rows(limit: Limit, drive: Drive) -> Rows:
    """Return a limit's rows on a drive.

    Raises:
        WrongKind: the limit returns no `Rows`.
    """
    rows = limit.rows(drive)
    reason = kind_issue(rows, Rows)
    if reason:
        raise WrongKind(f"limits.{limit.name}: rows: {reason}")
    return rows


@dataclass(frozen=True)
class LinearBound:
    """low <= slopes @ inputs + offset <= high, all SI.

    Attributes:
        slopes: (inputs,).
        offset: value at inputs of 0.
        low, high: the limit's own bounds.
    """

    slopes: Array
    offset: float
    low: float
    high: float

    def widened(self, share: float) -> LinearBound:
        """This bound where it is exceeded by at most `share` of the larger of both."""
        spare = share * max(abs(self.low), abs(self.high))
        return replace(self, low=self.low - spare, high=self.high + spare)


BOTH_ENDS = "{name} {amount} wider at both ends"
"""Text about a wider range: of a heater that gives 0 to 500 W, "5 W more" would be half of it."""


class Limit(Component, ABC):
    """One named limit on a drive.

    Attributes:
        looks_at: subject of the rows: "inputs", the splines and their derivatives; "state", every instant
            of the drive by itself, as its path and its motion have it; "run", whole runs. Rows of instants
            are written for `Instant`s too, which is how they are checked between the points of a drive. A
            limit that does not say (None) is checked at the points of its rows only.
        in_degrees: angles are shown in degrees.
        loosened: description of the limit that is wider by an `{amount}`.
        counts_trials: the rows are sums over all trials, each as often as it is carried out.
    """

    name: ClassVar[str]
    counts_trials: ClassVar[bool] = False
    in_degrees: ClassVar[bool] = False
    loosened: ClassVar[str] = "{amount} more {name}"
    looks_at: ClassVar[Literal["inputs", "state", "run"] | None] = None

    @abstractmethod
    def rows(self, drive: Drive) -> Rows:
        """The limit on `drive`, for all the times that the drive's values stand for."""

    def amount(self, excess: float) -> float:
        """Return the amount by which the limit is exceeded where its rows are by `excess`, both in its unit.

        The same, unless rows that an optimiser can follow measure it otherwise.
        """
        return excess

    def issues(self, system: System, space: Space) -> list[Issue]:
        """Return what makes this limit impossible for the system or the design space; [] if nothing."""
        return []

    def input_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Bounds that this limit sets directly on inputs, by input name."""
        return {}

    def linear_bounds(self, system: System) -> Sequence[LinearBound]:
        """Bounds that this limit sets on linear combinations of the inputs."""
        return ()

    def state_bounds(self) -> dict[str, tuple[float, float]]:
        """Bounds between which this limit keeps states, by the states' names, where it says any."""
        return {}

    def rate_bounds(self, system: System) -> dict[str, tuple[float, float]]:
        """Bounds that this limit sets directly on the inputs' rates, by input name."""
        return {}

    def widened_bounds(
        self, bounds: Mapping[str, tuple[float, float]], share: float, size: float
    ) -> dict[str, tuple[float, float]]:
        """Such bounds where the rows, of that size, are exceeded by at most `share` of it.

        Right where the rows are the inputs (or rates) themselves in any unit, or grow faster than they do; a
        limit whose rows grow more slowly says here how far its inputs get.

        Args:
            bounds: (min, max) by input name, SI.
            share: share of the size.
            size: size of the limit's rows, in their unit.
        """
        largest = max((abs(bound) for pair in bounds.values() for bound in pair), default=0.0)
        spare = share * max(size, largest)
        return {name: (low - spare, high + spare) for name, (low, high) in bounds.items()}


class PathLimit(Limit, ABC):
    """A limit on the states that the system is in: on each point of its path by itself.

    Attributes:
        per_metre: largest change of the rows while it moves 1 m through space; infinite where that is
            not bounded.
    """

    looks_at: ClassVar[Literal["state"]] = "state"
    per_metre: ClassVar[float] = inf

    @abstractmethod
    def rows_at(self, path: Expression, system: System) -> Rows:
        """The limit on points of a path (G, states): what it asks of all the points, one thing after the
        other, (k * G,).
        """

    def rows(self, drive: Drive) -> Rows:
        """The limit on every point of the path."""
        return self.rows_at(drive.path, drive.system)


class BareLimit(Limit, ABC):
    """A limit given by one value: in YAML, the value alone stands for {"bounds": value}."""

    @model_validator(mode="before")
    @classmethod
    def _bare_value(cls, value: Any) -> Any:
        return value if isinstance(value, dict) else {"bounds": value}


@dataclass(frozen=True)
class TwoSided:
    """Pydantic annotation: a pair (min, max), or one number b meaning (-b, b), in the dimension of `si`."""

    si: str
    example: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Parse units and spread a single number before the pair's own validation."""
        return handler(Annotated[source, BeforeValidator(self._pair)])

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """A quantity or a pair of them, for editors."""
        quantity = {"type": ["number", "string"]}
        pair = {"type": "array", "items": quantity, "minItems": 2, "maxItems": 2}
        return {"anyOf": [quantity, pair], "description": f"{self.example!r} or [min, max]"}

    def _pair(self, value: Any) -> tuple[float, float]:
        if isinstance(value, Sequence) and not isinstance(value, str):
            if len(value) != 2:
                raise ValueError(f"expected {self.example!r} or [min, max], got {len(value)} values")
            low, high = (parse_quantity(entry, self.si) for entry in value)
        else:
            high = parse_quantity(value, self.si)
            low = -high
            if high <= 0:
                raise ValueError(
                    f"expected a positive limit (or [min, max]), got {value!r}{counts_as_zero(value)}"
                )
        if not low < high:
            raise ValueError(f"expected min below max, got {value!r}")
        return low, high


class InputLimit(Limit, ABC):
    """A limit on every input of one quantity.

    Attributes:
        bounds: (min, max) of all those inputs, or one number for both directions.
        each: instead, bounds by the inputs' names.
    """

    looks_at: ClassVar[Literal["inputs"]] = "inputs"
    quantity: ClassVar[str]
    unit: ClassVar[str]
    bounds: tuple[float, float] | None = None
    each: Mapping[str, tuple[float, float]] | None = None

    @model_validator(mode="before")
    @classmethod
    def _bare_value(cls, value: Any) -> Any:
        if not isinstance(value, dict):
            return {"bounds": value}
        named = set(value) & {"bounds", "each"}
        return value if named else {"each": value}

    @model_validator(mode="after")
    def _one_way_to_give_them(self) -> InputLimit:
        if (self.bounds is None) == (not self.each):
            raise ValueError("expected bounds for all inputs alike, or bounds by the inputs' names")
        return self

    def issues(self, system: System, space: Space) -> list[Issue]:
        """A system without such inputs, inputs without bounds, bounds that its equations do not allow."""
        limited = [entry for entry in system.inputs if entry.quantity == self.quantity]
        if not limited:
            text = (
                f"{label_of(system)} has no {self.quantity}; its inputs are {', '.join(system.input_names)}"
            )
            return [Issue(("limits", self.name), text)]
        names = [entry.name for entry in limited]
        if self.each is not None and set(self.each) != set(names):
            text = f"expected bounds of {', '.join(names)}; got {', '.join(self.each)}"
            return [Issue(("limits", self.name), text)]
        return []

    def bounds_of(self, name: str) -> tuple[float, float]:
        """(min, max) of one input."""
        if self.bounds is not None:
            return self.bounds
        assert self.each is not None
        return self.each[name]

    def bounds_by_name(self, system: System) -> dict[str, tuple[float, float]]:
        """(min, max) of every input limited, by its name."""
        names = [entry.name for entry in system.inputs if entry.quantity == self.quantity]
        return {name: self.bounds_of(name) for name in names}

    def bounded(self, table: Expression, system: System) -> Rows:
        """The bounds on the limited columns of `table` (K, inputs); the size is the largest bound's."""
        bounds = self.bounds_by_name(system)
        columns = table[:, [system.input_names.index(name) for name in bounds]]
        pairs = np.array(list(bounds.values()), dtype=float).reshape(-1, 2)
        low, high = np.repeat(pairs, columns.shape[0], axis=0).T
        return Rows(ca.vec(columns), low, high, float(np.abs(pairs).max()), self.unit)


def rest_issues(limit: Limit, pairs: Iterable[tuple[float, float]], unit: str, space: Space) -> list[Issue]:
    """Bounds that exclude 0 where everything begins and ends there.

    Args:
        limit: limit that has the bounds.
        pairs: (min, max) of each input.
        unit: unit of the bounds.
        space: all drives.
    """
    if not space.rest_to_rest:
        return []
    return [
        Issue(
            ("limits", limit.name),
            f"[{low:g}, {high:g}] {unit} excludes 0, which trajectory.rest_to_rest needs",
        )
        for low, high in dict.fromkeys(pairs)
        if not low <= 0 <= high
    ]


def magnitude(first: Expression, second: Expression, size: float) -> Expression:
    """The length of vectors (first, second), exact at `size`; rounded at 0, for optimisers, where it is more
    by at most a thousandth of `size`.

    Args:
        first: coordinates (n,).
        second: coordinates (n,).
        size: length at which it is exact, in their unit.
    """
    soft = ROUNDED * size
    return ca.sqrt(first**2 + second**2 + soft**2) + (size - float(np.hypot(size, soft)))


def implied_bounds(bounds: Array, combined: Sequence[LinearBound]) -> Array:
    """Bounds on inputs (inputs, 2), where those `bounds` (inputs, 2) are infinite by what all say together.

    Infinite still where nothing follows.
    """
    if not combined or np.isfinite(bounds).all():
        return bounds
    table = np.array([bound.slopes for bound in combined])
    low, high = np.array([(bound.low - bound.offset, bound.high - bound.offset) for bound in combined]).T
    return np.array(
        [
            pair if np.isfinite(pair).all() else _reach(table, low, high, bounds, place)
            for place, pair in enumerate(bounds)
        ]
    )


def _reach(table: Array, low: Array, high: Array, bounds: Array, place: int) -> list[float]:
    # The least and the largest that one input can be.
    from scipy.optimize import linprog

    ends = []
    for sign in (1.0, -1.0):
        goal = sign * np.eye(len(bounds))[place]
        solution = linprog(goal, np.vstack([table, -table]), np.concatenate([high, -low]), bounds=bounds)
        end = float(sign * solution.fun) if solution.status == 0 else -sign * np.inf
        ends.append(end - sign * ROUNDING * abs(end))
    return ends
