"""A design problem: robot + design space + measurement + limits + criterion. It knows no solver."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.criteria import Criterion
from oed.errors import Flaw, ProblemError
from oed.expression import Expression
from oed.information import information, scaling_flaws
from oed.limits.limit import Limit
from oed.measurements.measurement import Block, Measurement
from oed.models.model import Model
from oed.rollout import Drive, roll_out
from oed.trajectory import DesignSpace

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Problem:
    """What to design for: a robot, the drives allowed, a measurement, limits and a criterion.

    Raises:
        ProblemError: the parts do not fit together; every reason is listed.
    """

    model: Model
    design: DesignSpace
    measurement: Measurement
    limits: tuple[Limit, ...]
    criterion: Criterion
    name: str = ""

    def __post_init__(self) -> None:
        """Check that the parts fit together."""
        object.__setattr__(self, "limits", tuple(self.limits))
        flaws = _flaws(self)
        if flaws:
            raise ProblemError(flaws)

    @cached_property
    def input_bounds(self) -> Array:
        """Bounds (inputs, 2) that the limits set on each input."""
        bounds = np.tile([-np.inf, np.inf], (len(self.model.inputs), 1))
        for limit in self.limits:
            for name, (low, high) in limit.input_bounds(self.model).items():
                row = bounds[self.model.input_names.index(name)]
                row[:] = max(row[0], low), min(row[1], high)
        return bounds

    def matrices(self, drive: Drive) -> tuple[tuple[Block, ...], list[Expression]]:
        """The measurement's regressions of a drive, and the information matrices the criterion judges."""
        blocks = self.measurement.blocks(drive)
        return blocks, [information(block, self.criterion.scaling) for block in blocks]

    def parameter_blocks(self) -> tuple[Block, ...]:
        """The measurement's regressions of any drive: for their parameters and noise, not their values."""
        return self.measurement.blocks(_any_drive(self))

    def __getstate__(self) -> dict[str, Any]:
        """The parts only: caches are made again where they are needed."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


def _flaws(problem: Problem) -> list[Flaw]:
    model, space = problem.model, problem.design
    flaws = []
    needed = space.spline.degree + (3 if space.rest_to_rest else 1)
    if space.spline.coefficients < needed:
        text = (
            f"a degree-{space.spline.degree} spline{' at rest at both ends' if space.rest_to_rest else ''} "
            f"needs at least {needed} coefficients, got {space.spline.coefficients}"
        )
        flaws.append(Flaw(("trajectory", "spline", "coefficients"), text))
    for limit in problem.limits:
        flaws += limit.flaws(model, space)
    names = [limit.name for limit in problem.limits]
    for name in sorted({name for name in names if names.count(name) > 1}):
        flaws.append(Flaw(("limits", name), "given twice; a limit is known by its name"))
    bounded = {name for limit in problem.limits for name in limit.input_bounds(model)}
    for entry in model.inputs:
        if entry.name not in bounded:
            text = f"nothing bounds {entry.name}; add {entry.quantity}, without which no design is best"
            flaws.append(Flaw(("limits",), text))
    flaws += problem.measurement.flaws(model, space.samples)
    # Blocks exist only for a measurement that fits the robot.
    return flaws or scaling_flaws(problem.parameter_blocks(), problem.criterion.scaling)


def _any_drive(problem: Problem) -> Drive:
    # A drive of the problem's shape without values: enough to ask which parameters there are.
    model, space = problem.model, problem.design
    inputs = ca.MX.sym("inputs", space.samples, len(model.inputs))
    return roll_out(
        model,
        space.integration,
        inputs=inputs,
        start=ca.MX.sym("start", len(model.states)),
        parameters=ca.MX(ca.DM(model.nominal)),
        period=ca.MX(space.period),
        input_values=inputs,
        input_rates=inputs,
    )
