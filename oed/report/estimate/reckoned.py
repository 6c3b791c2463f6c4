"""The driven paths, measured and by dead reckoning with nominal and with estimated parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.report.estimate.reading import Data, Reckoned, entries
from oed.report.parts.section import Picture, Section

Array = npt.NDArray[np.float64]

MOST_PATHS = 6
"""Paths that are drawn."""
LETTERS = 26
"""Of a panel's title."""


def reckoned(data: Data) -> Section | None:
    """Paths of logs that the estimate did not know, else of its own; None where there are no positions."""
    drawn = [one for one in map(_paths, entries(data, "paths")) if one is not None][:MOST_PATHS]
    if not drawn:
        return None
    caption = (
        "Measured path (solid), and dead reckoning from the same start with nominal (dashed) and with "
        "estimated parameters (dotted)."
    )
    alt = "Driven paths beside dead reckoning with nominal and with estimated parameters"
    return Section(
        "Driven paths",
        paragraphs=(_which(entries(data, "paths")[: len(drawn)]),),
        figures=(Picture("estimate_paths", alt, caption, partial(_draw, drawn)),),
    )


def _which(drawn: Sequence[Mapping[str, Any]]) -> str:
    roles = {str(one.get("role")) for one in drawn}
    if roles == {"fitted"}:
        what = "of the log that was fitted"
    elif roles == {"held out", "fitted"}:
        what = "of logs kept apart, and of the one that was fitted"
    elif roles == {"held out"}:
        what = "of logs that were kept apart"
    elif roles == {"left out"}:
        what = "of logs, each by the estimate from the others"
    else:
        what = "of logs kept apart, and of logs each by the estimate from the others"
    return f"Dead reckoning {what}: what the robot would take for its path if it relied on its wheels alone."


def _paths(one: Mapping[str, Any]) -> Reckoned | None:
    pairs = [_path(one, *keys) for keys in (("x", "y"), ("before_x", "before_y"), ("after_x", "after_y"))]
    if any(not np.isfinite(path).all(axis=1).any() for path in pairs):
        return None
    return Reckoned(shortened(str(one["log"])), *pairs)


def _path(one: Mapping[str, Any], x: str, y: str) -> Array:
    columns = [np.array(one.get(key) or [], dtype=float) for key in (x, y)]
    return np.column_stack(columns)


def shortened(name: str, letters: int = LETTERS) -> str:
    """A name with its middle left out where it is too long."""
    if len(name) <= letters:
        return name
    half = (letters - 1) // 2
    return f"{name[:half]}…{name[-half:]}"


def _draw(drawn: Sequence[Reckoned]) -> Any:
    from oed.report.estimate import figures

    return figures.paths(drawn)
