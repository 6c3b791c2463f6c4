"""What a drive must keep to: the Limit seam. A limit is a name and rows lower <= expression <= upper."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import casadi as ca
import numpy as np
import numpy.typing as npt
from pydantic import BeforeValidator, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic_core import CoreSchema

from oed.component import Component
from oed.errors import Flaw
from oed.expression import Expression
from oed.models.model import Model
from oed.quantities import parse_quantity
from oed.rollout import Drive
from oed.trajectory import DesignSpace

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
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


class Limit(Component, ABC):
    """One named limit on a drive."""

    name: ClassVar[str]

    @abstractmethod
    def rows(self, drive: Drive) -> Rows:
        """The limit on `drive`, for all the times that the drive's values stand for."""

    def flaws(self, model: Model, space: DesignSpace) -> list[Flaw]:
        """What makes this limit impossible for the robot or the design space; [] if nothing."""
        return []

    def input_bounds(self, model: Model) -> dict[str, tuple[float, float]]:
        """Bounds that this limit sets directly on inputs, by input name."""
        return {}

    def rate_bounds(self, model: Model) -> dict[str, tuple[float, float]]:
        """Bounds that this limit sets directly on the inputs' rates, by input name."""
        return {}


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
                raise ValueError(f"expected a positive limit (or [min, max]), got {value!r}")
        if not low < high:
            raise ValueError(f"expected min below max, got {value!r}")
        return low, high


class InputLimit(Limit, ABC):
    """A limit on every input of one quantity: `bounds` (min, max), or one number for both directions."""

    quantity: ClassVar[str]
    bounds: tuple[float, float]

    @model_validator(mode="before")
    @classmethod
    def _bare_value(cls, value: Any) -> Any:
        return value if isinstance(value, dict) else {"bounds": value}

    def flaws(self, model: Model, space: DesignSpace) -> list[Flaw]:
        """A robot without such inputs."""
        if self.indices(model):
            return []
        text = f"{model.kind} has no {self.quantity}; its inputs are {', '.join(model.input_names)}"
        return [Flaw(("limits", self.name), text)]

    def indices(self, model: Model) -> list[int]:
        """Which of the model's inputs are limited."""
        return [index for index, entry in enumerate(model.inputs) if entry.quantity == self.quantity]

    def bounds_by_name(self, model: Model) -> dict[str, tuple[float, float]]:
        """`bounds` under the name of every input limited."""
        return {model.input_names[index]: self.bounds for index in self.indices(model)}

    def bounded(self, columns: Expression, unit: str) -> Rows:
        """`bounds` on every entry of `columns`; the size is the larger bound's magnitude."""
        count = columns.numel()
        low, high = self.bounds
        size = max(abs(low), abs(high))
        return Rows(ca.vec(columns), np.full(count, low), np.full(count, high), size, unit)
