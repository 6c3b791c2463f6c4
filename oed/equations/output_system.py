"""Systems with outputs, and the key of a study that gives one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar

import casadi as ca

from oed.equations.dimensions import Dimension, Quantity
from oed.equations.initial_values import InitialValue
from oed.foundation.component import Component
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System


class OutputSystem(System, ABC):
    """A system with outputs that can be read; they are among its signals.

    Attributes:
        dimensions: dimensions of states, inputs, parameters, outputs and whatever else has a name.
        output_dimensions: dimensions of the outputs, by name.
    """

    dimensions: ClassVar[Mapping[str, Dimension]]
    output_dimensions: ClassVar[Mapping[str, Dimension]]

    @abstractmethod
    def values_at(self, state: Expression, inputs: Expression, parameters: Expression) -> Mapping[str, Any]:
        """Return the values of all that `dimensions` names, SI.

        Args:
            state: states, (states,), SI.
            inputs: inputs, (inputs,), SI.
            parameters: parameters, (p,), SI.
        """

    @abstractmethod
    def outputs(
        self, state: Expression, inputs: Expression, parameters: Expression
    ) -> Mapping[str, Expression]:
        """Return the outputs by name, SI.

        Args:
            state: states, (states,), SI.
            inputs: inputs, (inputs,), SI.
            parameters: parameters, (p,), SI.
        """

    @property
    def integrates(self) -> bool:
        """True if the system has states, which are integrated."""
        return bool(self.states)

    def signals(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Mapping[str, Expression]:
        """Return the outputs in a state; those in the middle of a period for its means, to second order."""
        instant = not self.states or (not isinstance(period, ca.MX) and ca.SX(period).is_zero())
        at = state if instant else self.step(state, inputs, parameters, period / 2)
        return self.outputs(at, inputs, parameters)


def by_name(names: Iterable[str], *columns: Expression) -> dict[str, Expression]:
    """Return the entries of column vectors, one after the other, by name."""
    return dict(zip(names, ca.vertsplit(ca.vertcat(*columns)), strict=True))


class SystemKeys(Component, ABC):
    """A study's key `system`."""

    kind: str

    @property
    @abstractmethod
    def system(self) -> OutputSystem:
        """The system.

        Raises:
            ProblemError: mistakes in it, by key and column.
        """

    @property
    @abstractmethod
    def initial_values(self) -> Mapping[str, InitialValue]:
        """Initial values of all states, by name.

        Raises:
            ProblemError: no quantities, different units, or bounds that do not rise.
        """

    @property
    def quantities(self) -> Mapping[str, Quantity]:
        """Parameters and initial values as texts or numbers of the study, by name."""
        return {}
