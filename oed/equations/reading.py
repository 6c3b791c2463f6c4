"""Reading of a system's equations: every mistake by its key and column."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from graphlib import CycleError, TopologicalSorter
from typing import Any, TypeVar

from oed.equations.dimensions import PLAIN, TIME, Dimension, parse_unit, quantity
from oed.equations.grammar import name_issue, parse
from oed.equations.issues import Issues
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean

INTEGRATORS = {"runge_kutta": 10, "radau": 4}
"""Integrators, and their steps in a period by default."""
Value = TypeVar("Value")


class Reader:
    """Names, units, values and expressions of a system, read and checked.

    Attributes:
        dimensions: dimensions of all names but the outputs'.
        output_dimensions: dimensions of the outputs, by name.
        parameters: nominal values, SI, and dimensions by name.
        guesses: guesses of the algebraic states, SI, and dimensions by name.
        expressions: expressions by key and name.
        order: names of the definitions, each after those that it needs.

    Args:
        keys: units, values and expressions by name, by the keys that `Equations` takes.
        integrator: name of the integrator.
        substeps: steps in a period; None by default.
    """

    def __init__(self, keys: Mapping[str, Mapping[str, Any]], integrator: str, substeps: int | None) -> None:
        """Read all that there is.

        Raises:
            ProblemError: every name, expression or unit that does not fit.
        """
        self.keys, self.issues = keys, Issues("system")
        self._check_names()
        self.dimensions = self._read("states", _si_unit) | self._read("inputs", _si_unit)
        self.parameters = self._read("parameters", quantity)
        self.guesses = self._read("algebraic_states", quantity)
        values = self.parameters | self.guesses
        self.dimensions |= {name: dimension for name, (_, dimension) in values.items()}
        self.expressions = {
            key: self._read(key, parse) for key in ("define", "derivatives", "algebraic", "outputs")
        }
        for owner, key, missing in (
            ("state", "derivatives", "the derivative of {} is missing"),
            ("algebraic state", "algebraic", "the equation of {}, what is 0, is missing"),
        ):
            names = keys[owner.replace(" ", "_") + "s"]
            unknown = f"{{}} is no {owner}; the {owner}s are {', '.join(names) or 'none'}"
            self.issues.compare(keys[key], names, missing, unknown, key)
        self._check_integrator(integrator, substeps)
        self.order = self._ordered()
        self.output_dimensions = dict[str, Dimension]()
        self.issues.check()
        self._check_dimensions()
        self.issues.check()

    def _read(self, key: str, read: Callable[[Any], Value]) -> dict[str, Value]:
        results = dict[str, Value]()
        for name, text in self.keys[key].items():
            with self.issues.at(key, name):
                results[name] = read(text)
        return results

    def _check_names(self) -> None:
        # No name is unfit for expressions, or stands for two things.
        owner = dict[str, str]()
        for key in ("states", "algebraic_states", "inputs", "parameters", "define"):
            for name in self.keys[key]:
                reason = name_issue(name)
                if name in owner:
                    reason = f"{name} is among the {owner[name].replace('_', ' ')} already"
                if reason:
                    self.issues.add(reason, key, name)
                owner.setdefault(name, key)

    def _check_integrator(self, integrator: str, substeps: int | None) -> None:
        if not self.keys["outputs"]:
            self.issues.add("there is nothing to read: name at least one output", "outputs")
        if substeps is not None and substeps < 1:
            self.issues.add(f"expected at least 1, got {substeps}", "substeps")
        if integrator not in INTEGRATORS:
            there_are = f"expected {' or '.join(INTEGRATORS)}, got {written(integrator)}"
            self.issues.add(f"{there_are}{did_you_mean(integrator, INTEGRATORS)}", "integrator")
        elif self.keys["states"] and self.keys["algebraic_states"] and integrator != "radau":
            self.issues.add("states beside algebraic states are followed by radau alone", "integrator")

    def _ordered(self) -> tuple[str, ...]:
        definitions = self.expressions["define"]
        needs = {
            name: [used for used in definition.names if used in definitions]
            for name, definition in definitions.items()
        }
        try:
            return tuple(TopologicalSorter(needs).static_order())
        except CycleError as error:
            first, *further = reversed(error.args[1])
            self.issues.add(f"is defined by itself: {' needs '.join([first, *further])}", "define", first)
            return ()

    def _check_dimensions(self) -> None:
        for name in self.order:
            self.dimensions[name] = PLAIN
            with self.issues.at("define", name):
                definition = self.expressions["define"][name]
                self.dimensions[name] = definition.dimension(self.dimensions) or PLAIN
        for name, rate in self.expressions["derivatives"].items():
            with self.issues.at("derivatives", name):
                rate.require(self.dimensions[name] / TIME, self.dimensions)
        for name, residual in self.expressions["algebraic"].items():
            with self.issues.at("algebraic", name):
                residual.dimension(self.dimensions)
        for name, output in self.expressions["outputs"].items():
            with self.issues.at("outputs", name):
                self.output_dimensions[name] = output.dimension(self.dimensions) or PLAIN


def _si_unit(text: str) -> Dimension:
    factor, dimension = parse_unit(text)
    if factor != 1:
        raise ValueError(f"expected an SI unit such as {dimension.text or '1'}, got {text!r}")
    return dimension
