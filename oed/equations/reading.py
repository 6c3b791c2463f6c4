"""What a system of equations is given by, read and checked: every mistake by its key and column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

from oed.equations.dimensions import PLAIN, TIME, Dimension, parse_unit, quantity
from oed.equations.grammar import Expression, ExpressionError, name_flaw, parse
from oed.foundation.errors import Flaw, ProblemError

TEXTS = ("define", "derivatives", "outputs")
"""Keys with expressions."""


@dataclass(frozen=True)
class Given:
    """Names, units, values and expressions, as texts; see `Equations`."""

    states: Mapping[str, str]
    inputs: Mapping[str, str]
    parameters: Mapping[str, str | float]
    define: Mapping[str, str]
    derivatives: Mapping[str, str]
    outputs: Mapping[str, str]
    substeps: int


class Reader:
    """Reads what is given.

    Attributes:
        given: that.
        flaws: what is wrong with it, as far as it is read.
        dimensions: of all names.
        values: of the parameters, SI.
        expressions: by key and name.
        order: of the definitions, each after those that it needs.

    Args:
        given: names, units, values and expressions.
    """

    def __init__(self, given: Given) -> None:
        """Read all that can be read by itself."""
        self.given, self.flaws = given, list[Flaw]()
        self.dimensions, self.values = dict[str, Dimension](), dict[str, float]()
        self._names()
        self._units("states", given.states)
        self._units("inputs", given.inputs)
        self._parameters()
        self.expressions = {key: self._parsed(key, getattr(given, key)) for key in TEXTS}
        self._complete()
        self.order = self._ordered()

    def check(self) -> None:
        """Check the units of all terms.

        Raises:
            ProblemError: all that is wrong.
        """
        if not self.flaws:
            for name in self.order:
                self.dimensions[name] = self._dimension("define", name)
            for name in self.expressions["derivatives"]:
                self._dimension("derivatives", name, self.dimensions[name] / TIME)
            for name in self.expressions["outputs"]:
                self._dimension("outputs", name)
        if self.flaws:
            raise ProblemError(self.flaws)

    def _wrong(self, message: str, *key: str) -> None:
        self.flaws.append(Flaw(("system", *key), message))

    def _names(self) -> None:
        # Names that no expression can have, and names of two things.
        owner = dict[str, str]()
        for key in ("states", "inputs", "parameters", "define"):
            for name in getattr(self.given, key):
                taken = f"{name} is among the {owner[name]} already" if name in owner else ""
                reason = taken or name_flaw(name)
                owner.setdefault(name, key)
                if reason:
                    self._wrong(reason, key, name)

    def _units(self, key: str, units: Mapping[str, str]) -> None:
        for name, text in units.items():
            try:
                factor, self.dimensions[name] = parse_unit(text)
            except ValueError as error:
                self._wrong(str(error), key, name)
                continue
            if factor != 1:
                wanted = self.dimensions[name].text or "1"
                self._wrong(f"expected an SI unit such as {wanted}, got {text!r}", key, name)

    def _parameters(self) -> None:
        for name, value in self.given.parameters.items():
            try:
                self.values[name], self.dimensions[name] = quantity(value)
            except ValueError as error:
                self._wrong(str(error), "parameters", name)

    def _parsed(self, key: str, texts: Mapping[str, str]) -> dict[str, Expression]:
        found = {}
        for name, text in texts.items():
            try:
                found[name] = parse(text)
            except ExpressionError as error:
                self._at(key, name, error)
        return found

    def _complete(self) -> None:
        # A derivative of each state and of nothing else, something to read, and steps to take.
        states, derivatives = self.given.states, self.given.derivatives
        for name in states:
            if name not in derivatives:
                self._wrong(f"the derivative of {name} is missing", "derivatives")
        for name in derivatives:
            if name not in states:
                known = ", ".join(states) or "none"
                self._wrong(f"{name} is no state; the states are {known}", "derivatives", name)
        if not self.given.outputs:
            self._wrong("there is nothing to read: name at least one output", "outputs")
        if self.given.substeps < 1:
            self._wrong(f"expected at least 1, got {self.given.substeps}", "substeps")

    def _ordered(self) -> tuple[str, ...]:
        defined = self.expressions["define"]
        needs = {name: [other for other in one.names if other in defined] for name, one in defined.items()}
        try:
            return tuple(TopologicalSorter(needs).static_order())
        except CycleError as error:
            first, *further = reversed(error.args[1])
            self._wrong(f"is defined by itself: {' needs '.join([first, *further])}", "define", first)
            return ()

    def _dimension(self, key: str, name: str, expected: Dimension | None = None) -> Dimension:
        # Of an expression, which may have to be a certain one.
        one = self.expressions[key][name]
        try:
            if expected is not None:
                one.require(expected, self.dimensions)
            return one.dimension(self.dimensions) or PLAIN
        except ExpressionError as error:
            self._at(key, name, error)
            return PLAIN

    def _at(self, key: str, name: str, error: ExpressionError) -> None:
        self._wrong(f"column {error.offset + 1}: {error.message}", key, name)
