"""A robot seen through its coefficients: the same motion, with the matrix c as its parameters."""

from __future__ import annotations

from typing import Any, Literal

import casadi as ca
import numpy as np
import numpy.typing as npt
from pydantic import model_validator

from oed.kernel.dynamics.expression import Expression
from oed.robots.models.model import Input, Model, Parameter, coefficient_twist, nominal_coefficients

Array = npt.NDArray[np.float64]


class CoefficientRobot(Model):
    """The robot `base` with the entries of c [Choi, eq. 5] as parameters, its other constants nominal.

    It answers what an estimate of c means for the motion, e.g. which headings it predicts.
    """

    kind: Literal["coefficients"] = "coefficients"
    base: Model

    @model_validator(mode="before")
    @classmethod
    def _body_of_the_base(cls, data: dict[str, Any]) -> dict[str, Any]:
        return {"body_radius": data["base"].body_radius, **data}

    @property
    def inputs(self) -> tuple[Input, ...]:  # type: ignore[override]
        """The base robot's inputs."""
        return self.base.inputs

    @property
    def states(self) -> tuple[str, ...]:  # type: ignore[override]
        """The base robot's states."""
        return self.base.states

    @property
    def state_units(self) -> tuple[str, ...]:  # type: ignore[override]
        """Their units."""
        return self.base.state_units

    @property
    def coefficient_names(self) -> tuple[tuple[str, ...], ...]:  # type: ignore[override]
        """The base robot's coefficient names."""
        return self.base.coefficient_names

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The coefficients, row by row: yaw rate [1], then forward and lateral speed [m]."""
        nominal = nominal_coefficients(self.base)
        return tuple(
            Parameter(name, float(value), unit)
            for names, values, unit in zip(self.coefficient_names, nominal, ("", "m", "m"), strict=False)
            for name, value in zip(names, values, strict=True)
        )

    def coefficients(self, parameters: Expression) -> Expression:
        """The parameters as the matrix c."""
        rows, columns = len(self.coefficient_names), len(self.coefficient_names[0])
        return ca.reshape(parameters, columns, rows).T

    def effective_inputs(self, inputs: Expression, parameters: Expression) -> Expression:
        """As the base robot's at its nominal constants."""
        return self.base.effective_inputs(inputs, ca.DM(self.base.nominal))

    def mean_twist(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """As the base robot's at its nominal constants."""
        return self.base.mean_twist(state, twist, ca.DM(self.base.nominal), period)

    def internal_step(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """As the base robot's at its nominal constants."""
        return self.base.internal_step(state, twist, ca.DM(self.base.nominal), period)

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed, 0, yaw rate [Choi, eq. 5]."""
        return coefficient_twist(self, inputs, parameters)


def coefficient_values(model: Model, parameters: Array) -> tuple[tuple[str, ...], Array, Array]:
    """Names (q,), values (q,) and derivatives (q, p) of a robot's coefficients at parameter values (p,), SI.

    Nothing for a robot whose twist is not linear in coefficients.
    """
    names = tuple(name for row in model.coefficient_names for name in row)
    if not names:
        return (), np.zeros(0), np.zeros((0, len(parameters)))
    symbols = ca.SX.sym("p", len(parameters))
    entries = ca.vec(model.coefficients(symbols).T)
    function = ca.Function("coefficients", [symbols], [entries, ca.densify(ca.jacobian(entries, symbols))])
    values, slopes = function(parameters)
    return names, np.array(values).ravel(), np.array(slopes)
