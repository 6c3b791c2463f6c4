"""Numbers as JSON holds them: null where there is none."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def finite(value: float | None) -> float | None:
    """The value where JSON can hold it, else None."""
    return float(value) if value is not None and math.isfinite(value) else None


def finite_data(value: Any) -> Any:
    """Plain data, null where JSON cannot hold a number."""
    if isinstance(value, Mapping):
        return {key: finite_data(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite_data(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finite_rows(matrix: Any) -> list[list[float | None]]:
    """A matrix as lists, null where JSON cannot hold a number."""
    return [[finite(value) for value in row] for row in np.asarray(matrix)]


def rounded(values: Any, digits: int) -> Any:
    """Nested lists of an array's values, rounded: for series that are drawn, not computed with."""
    return np.round(np.asarray(values, dtype=float), digits).tolist()
