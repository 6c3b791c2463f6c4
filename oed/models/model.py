"""What moves: the Model seam, and the planar step that every robot shares.

A robot names its inputs and parameters and says which body twist they give. Pose integration, design
matrices and derivatives follow from that. Expressions are CasADi's, for one sample; the callers map
them over time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

import casadi as ca

from oed.component import Component
from oed.expression import Expression

Integration = Literal["arc", "midpoint"]


@dataclass(frozen=True)
class Input:
    """One input of a model: its name in files, the quantity it is (limits apply by quantity), its unit."""

    name: str
    quantity: str
    unit: str


@dataclass(frozen=True)
class Parameter:
    """One constant of a model: name, nominal value in SI, SI unit ("" for a ratio)."""

    name: str
    nominal: float
    unit: str


class Model(Component, ABC):
    """A planar robot: state (x, y, heading), inputs, parameters and the body twist they give."""

    kind: str
    inputs: ClassVar[tuple[Input, ...]]
    states: ClassVar[tuple[str, ...]] = ("x", "y", "heading")
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Names of the coefficient matrix's entries, row by row; () for a twist that is not linear in any."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """The kinematic parameters with their nominal values, in the order `twist` takes them."""

    @abstractmethod
    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Body twist (3,): forward speed [m/s], lateral speed to the left [m/s], yaw rate [rad/s].

        Args:
            inputs: one sample's inputs, (len(self.inputs),).
            parameters: parameter values, (len(self.parameters),), SI.
        """

    def coefficients(self, parameters: Expression) -> Expression:
        """Coefficient matrix c of [yaw rate; forward speed] = c @ effective inputs [Choi, eqs 5, 6].

        Raises:
            NotImplementedError: the twist is not linear in any coefficients.
        """
        raise NotImplementedError(f"the twist of {self.kind} is not linear in coefficients")

    def effective_inputs(self, inputs: Expression, parameters: Expression) -> Expression:
        """Inputs as they act on the ground, e.g. wheel speeds less slip; the inputs themselves by default."""
        return inputs

    @property
    def nominal(self) -> list[float]:
        """Nominal parameter values, SI."""
        return [parameter.nominal for parameter in self.parameters]

    @property
    def input_names(self) -> tuple[str, ...]:
        """The inputs' names."""
        return tuple(entry.name for entry in self.inputs)


def coefficient_twist(model: Model, inputs: Expression, parameters: Expression) -> Expression:
    """The twist (3,) of a robot whose [yaw rate; forward speed] is c @ effective inputs [Choi, eq. 5]."""
    product = model.coefficients(parameters) @ model.effective_inputs(inputs, parameters)
    return ca.vertcat(product[1], 0, product[0])


def sinc(angle: Expression) -> Expression:
    """sin(angle) / angle, by its series near 0, so that every derivative is finite there."""
    small = ca.fabs(angle) < 0.02
    square = angle * angle
    series = 1 - square / 6 * (1 - square / 20 * (1 - square / 42))
    return ca.if_else(small, series, ca.sin(angle) / ca.if_else(small, 1, angle))


def chord(
    yaw_rate: Expression, heading: Expression, period: Expression, integration: Integration
) -> tuple[Expression, Expression]:
    """How a sample's speed moves the pose: (gain [s], direction [rad]); displacement = gain * R(direction) v.

    `arc` is exact for a constant twist: the chord of the arc has length factor sinc(T Omega / 2).
    `midpoint` is the paper's rule, gain T [Choi, eq. 8].
    """
    half_turn = period * yaw_rate / 2
    gain = period * sinc(half_turn) if integration == "arc" else period + 0 * half_turn
    return gain, heading + half_turn


def step(model: Model, integration: Integration) -> ca.Function:
    """The function (pose, inputs, parameters, period [s]) -> next pose, shared by all robots."""
    pose, period = ca.SX.sym("pose", len(model.states)), ca.SX.sym("period")
    inputs, parameters = ca.SX.sym("inputs", len(model.inputs)), ca.SX.sym("p", len(model.parameters))
    forward, lateral, yaw_rate = ca.vertsplit(model.twist(inputs, parameters))
    gain, direction = chord(yaw_rate, pose[2], period, integration)
    cosine, sine = ca.cos(direction), ca.sin(direction)
    following = ca.vertcat(
        pose[0] + gain * (forward * cosine - lateral * sine),
        pose[1] + gain * (forward * sine + lateral * cosine),
        pose[2] + period * yaw_rate,
    )
    return ca.Function(
        "step",
        [pose, inputs, parameters, period],
        [following],
        ["pose", "inputs", "parameters", "period"],
        ["next"],
    )
