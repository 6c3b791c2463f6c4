"""What wheeled robots have in common: the matrix c, and inputs and geometry of two sides."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

import casadi as ca
from pydantic import Field, model_validator

from oed.foundation.component import Component
from oed.foundation.quantities import Length
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter
from oed.robots.models.coefficients import coefficient_twist
from oed.robots.models.model import Model

PositiveLength = Annotated[Length, Field(gt=0)]

TWO_WHEEL_SPEEDS = (
    Input("wheel_speed_right", "wheel_speed", "rad/s"),
    Input("wheel_speed_left", "wheel_speed", "rad/s"),
)


def matrix_names(rows: int, columns: int) -> tuple[tuple[str, ...], ...]:
    """Names of the entries of a matrix c: c11, c12, ... of its first row."""
    return tuple(tuple(f"c{row + 1}{column + 1}" for column in range(columns)) for row in range(rows))


class TwoSidedGeometry(Component):
    """Wheel radii and track of a robot with a right and a left side; lengths in m.

    Either `wheel_radius` for both sides, or `wheel_radius_right` and `wheel_radius_left`.
    """

    short_forms: ClassVar[tuple[str, ...]] = ("wheel_radius",)
    wheel_radius: PositiveLength | None = None
    wheel_radius_right: PositiveLength | None = None
    wheel_radius_left: PositiveLength | None = None
    track: PositiveLength

    @model_validator(mode="after")
    def _one_way_to_give_radii(self) -> TwoSidedGeometry:
        sides = (self.wheel_radius_right, self.wheel_radius_left)
        both = all(side is not None for side in sides)
        neither = all(side is None for side in sides)
        if not ((self.wheel_radius is not None and neither) or (self.wheel_radius is None and both)):
            raise ValueError("expected either wheel_radius, or both wheel_radius_right and wheel_radius_left")
        return self

    @property
    def radii(self) -> tuple[float, float]:
        """Nominal wheel radii (right, left) [m]."""
        if self.wheel_radius is not None:
            return self.wheel_radius, self.wheel_radius
        assert self.wheel_radius_right is not None
        assert self.wheel_radius_left is not None
        return self.wheel_radius_right, self.wheel_radius_left


@dataclass(frozen=True)
class Constant:
    """A field of a robot that is one of its parameters, where it is given.

    Attributes:
        name: of the field, and of the parameter.
        unit: SI unit ("" for a ratio).
        size: what a relative precision refers to where it is 0, SI: a number, or another field's name.
    """

    name: str
    unit: str = ""
    size: str | float = 0.0


class WheeledRobot(Model):
    """A robot whose parameters are fields: its `constants`, in their order."""

    constants: ClassVar[tuple[Constant, ...]] = ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its constants, but for those that are None."""
        given = [one for one in self.constants if getattr(self, one.name) is not None]
        sizes = (getattr(self, one.size) if isinstance(one.size, str) else one.size for one in given)
        pairs = zip(given, sizes, strict=True)
        return tuple(Parameter(one.name, getattr(self, one.name), one.unit, size) for one, size in pairs)


class LinearInCoefficients(WheeledRobot):
    """A robot whose twist is linear in the coefficients that it names, as they stand in the matrix c."""

    @abstractmethod
    def coefficients(self, parameters: Expression) -> Expression:
        """The matrix c of [yaw rate; forward speed; lateral speed, where it has one]."""

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward and lateral speed, yaw rate [Choi, eqs 2, 4]."""
        return coefficient_twist(self, inputs, parameters)


class TwoSidedRobot(TwoSidedGeometry, LinearInCoefficients):
    """A robot with a right and a left side, each driven; its constants follow both radii and the track."""

    inputs: ClassVar[tuple[Input, ...]] = TWO_WHEEL_SPEEDS
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = matrix_names(2, 2)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """wheel_radius_right, wheel_radius_left, track [m], and its constants."""
        right, left = self.radii
        sides = (("wheel_radius_right", right), ("wheel_radius_left", left), ("track", self.track))
        return (*(Parameter(name, value, "m") for name, value in sides), *super().parameters)

    def coefficients(self, parameters: Expression) -> Expression:
        """C = [[r_R/B, -r_L/B], [r_R/2, r_L/2]] (2, 2): [1/1; m] per unit of wheel angle [Choi, eq. 6]."""
        radius_right, radius_left, track = parameters[0], parameters[1], parameters[2]
        return ca.vertcat(
            ca.horzcat(radius_right / track, -radius_left / track),
            ca.horzcat(radius_right / 2, radius_left / 2),
        )
