"""Values to be drawn over what was varied."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Chart:
    """Values over what was varied.

    Attributes:
        across: name of the key along the axis, with its unit.
        places: its values, numbers or words.
        series: for each combination of the other keys its name and the value of each place; None where there
            is none.
        quantity: what the values are, with their unit.
        title: of the panel.
    """

    across: str
    places: tuple[float, ...] | tuple[str, ...]
    series: tuple[tuple[str, tuple[float | None, ...]], ...]
    quantity: str
    title: str = ""
