"""A baseline of the user's own: a pattern of moves by its class, named in a study by where that stands."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from oed.foundation.component import Component
from oed.foundation.own.code import place_of
from oed.foundation.own.part import OwnCodeError, OwnDescription, OwnPart
from oed.foundation.shown import written
from oed.foundation.text import NAME
from oed.robots.baselines.patterns import Move


class Baseline(Component, ABC):
    """A drive to compare designs with, as moves; it is placed, made as large as fits and driven in laps.

    Attributes:
        name: of its result; the kind by default.
    """

    kind: str
    name: Annotated[str, Field(pattern=NAME)] | None = None

    @abstractmethod
    def moves(self, size: float, lap: int) -> Sequence[Move]:
        """The moves of one lap, each driven from rest to rest.

        Args:
            size: of the pattern [m]; twice the size is twice as wide.
            lap: its number, from 0.
        """

    @property
    def label(self) -> str:
        """The result's name."""
        return self.name or self.kind

    def lap(self, size: float, lap: int) -> list[Move]:
        """The moves of one lap, checked.

        Args:
            size: of the pattern [m].
            lap: its number, from 0.

        Raises:
            OwnCodeError: what came is no list of moves.
        """
        found = self.moves(size, lap)
        reason = _reason(found)
        if reason:
            raise OwnCodeError(place_of(type(self))[0], f"moves: {reason}")
        return list(found)


def _reason(found: Any) -> str:
    # Why something is no list of moves; "" where it is.
    if not isinstance(found, list | tuple) or not found or not all(isinstance(one, Move) for one in found):
        return f"expected a list of at least one oed.Move, got {written(found)}"
    wrong = next((one for one in found if not _finite(one)), None)
    return "" if wrong is None else f"expected finite numbers, got {written(wrong)}"


def _finite(move: Move) -> bool:
    numbers = (move.forward, move.turn, move.sideways)
    return all(isinstance(one, float | int) and math.isfinite(one) for one in numbers)


class PythonBaseline(OwnPart, Baseline, extra="allow"):
    """The baseline that `object` ("my_module:MyBaseline") makes of all further keys."""

    noun = "baseline"
    kind: Literal["python"] = "python"
    described: OwnDescription | None = None

    def try_out(self, part: Any) -> None:
        """Ask the baseline for two laps.

        Raises:
            ValueError: what it says is no list of moves, or its kind is another baseline's.
        """
        for lap in (0, 1):
            try:
                part.lap(1.0, lap)
            except OwnCodeError as error:
                raise ValueError(error.reason) from None
