"""What a system of equations is given by, read and checked: every mistake by its key and column."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

from oed.equations.dimensions import PLAIN, TIME, Dimension, parse_unit, quantity
from oed.equations.grammar import Expression, ExpressionError, name_issue, parse
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean

TEXTS = ("define", "derivatives", "algebraic", "outputs")
"""Keys with expressions."""
INTEGRATORS = {"runge_kutta": 10, "radau": 4}
"""How states may be followed, with the steps in a period where nobody says."""


@dataclass(frozen=True)
class Given:
    """Names, units, values and expressions, as texts; see `Equations`."""

    states: Mapping[str, str]
    inputs: Mapping[str, str]
    parameters: Mapping[str, str | float]
    define: Mapping[str, str]
    derivatives: Mapping[str, str]
    algebraic_states: Mapping[str, str | float]
    algebraic: Mapping[str, str]
    outputs: Mapping[str, str]
    integrator: str
    substeps: int | None


class Reader:
    """Reads what is given.

    Attributes:
        given: that.
        issues: what is wrong with it, as far as it is read.
        dimensions: of all names.
        values: of the parameters, SI.
        guesses: of the algebraic states, SI.
        expressions: by key and name.
        order: of the definitions, each after those that it needs.

    Args:
        given: names, units, values and expressions.
    """

    def __init__(self, given: Given) -> None:
        """Read all that can be read by itself."""
        self.given, self.issues = given, list[Issue]()
        self.dimensions = dict[str, Dimension]()
        self._names()
        self._units("states", given.states)
        self._units("inputs", given.inputs)
        self.values = self._quantities("parameters", given.parameters)
        self.guesses = self._quantities("algebraic_states", given.algebraic_states)
        self.expressions = {key: self._parsed(key, getattr(given, key)) for key in TEXTS}
        self._complete("states", "derivatives", "the derivative of {}")
        self._complete("algebraic_states", "algebraic", "the equation of {}, what is 0,")
        self._possible()
        self.order = self._ordered()

    def check(self) -> None:
        """Check the units of all terms.

        Raises:
            ProblemError: all that is wrong.
        """
        if not self.issues:
            for name in self.order:
                self.dimensions[name] = self._dimension("define", name)
            for name in self.expressions["derivatives"]:
                self._dimension("derivatives", name, self.dimensions[name] / TIME)
            for key in ("algebraic", "outputs"):
                for name in self.expressions[key]:
                    self._dimension(key, name)
        if self.issues:
            raise ProblemError(self.issues)

    def _wrong(self, message: str, *key: str) -> None:
        self.issues.append(Issue(("system", *key), message))

    def _names(self) -> None:
        # Names that no expression can have, and names of two things.
        owner = dict[str, str]()
        for key in ("states", "algebraic_states", "inputs", "parameters", "define"):
            for name in getattr(self.given, key):
                taken = (
                    f"{name} is among the {owner[name].replace('_', ' ')} already" if name in owner else ""
                )
                reason = taken or name_issue(name)
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

    def _quantities(self, key: str, given: Mapping[str, str | float]) -> dict[str, float]:
        found = dict[str, float]()
        for name, value in given.items():
            try:
                found[name], self.dimensions[name] = quantity(value)
            except ValueError as error:
                self._wrong(str(error), key, name)
        return found

    def _parsed(self, key: str, texts: Mapping[str, str]) -> dict[str, Expression]:
        found = {}
        for name, text in texts.items():
            try:
                found[name] = parse(text)
            except ExpressionError as error:
                self._at(key, name, error)
        return found

    def _complete(self, owners: str, key: str, what: str) -> None:
        # An expression of each, and of nothing else.
        names, given = getattr(self.given, owners), getattr(self.given, key)
        for name in names:
            if name not in given:
                self._wrong(f"{what.format(name)} is missing", key)
        kind = owners.replace("_", " ")
        for name in given:
            if name not in names:
                known = ", ".join(names) or "none"
                self._wrong(f"{name} is no {kind[:-1]}; the {kind} are {known}", key, name)

    def _possible(self) -> None:
        # Something to read, and steps to take that the equations allow.
        integrator, substeps = self.given.integrator, self.given.substeps
        if not self.given.outputs:
            self._wrong("there is nothing to read: name at least one output", "outputs")
        if substeps is not None and substeps < 1:
            self._wrong(f"expected at least 1, got {substeps}", "substeps")
        if integrator not in INTEGRATORS:
            there_are = f"expected {' or '.join(INTEGRATORS)}, got {written(integrator)}"
            self._wrong(f"{there_are}{did_you_mean(integrator, INTEGRATORS)}", "integrator")
        elif self.given.states and self.given.algebraic_states and integrator != "radau":
            self._wrong("states beside algebraic states are followed by radau alone", "integrator")

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
