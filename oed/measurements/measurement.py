"""What is measured: the Measurement seam. A measurement turns a drive into design matrices and noise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oed.component import Component
from oed.errors import Flaw
from oed.expression import Expression
from oed.models.model import Model
from oed.rollout import Drive


@dataclass(frozen=True)
class Block:
    """One linear regression y = W c + noise, estimated by itself.

    Attributes:
        name: "position", "heading", ...
        design_matrix: W (rows, parameters), an expression.
        parameters: the parameters' names.
        nominal: their nominal values, (parameters,), SI.
        unit: their SI unit ("" for a ratio).
        noise: standard deviation of one row's noise, or None where it is not known.
    """

    name: str
    design_matrix: Expression
    parameters: tuple[str, ...]
    nominal: npt.NDArray[np.float64]
    unit: str
    noise: float | None


class Measurement(Component, ABC):
    """What is measured, when, and with what noise."""

    kind: str

    @abstractmethod
    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """The regressions that this measurement of `drive` allows, each with its own parameters."""

    def flaws(self, model: Model, samples: int) -> list[Flaw]:
        """What makes this measurement impossible for `model` and that many samples; [] if nothing."""
        return []
