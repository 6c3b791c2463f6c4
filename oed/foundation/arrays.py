"""The types of NumPy arrays in signatures, what rounding is in them, and places of blocks."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[np.float64]
Bools: TypeAlias = npt.NDArray[np.bool_]
Places: TypeAlias = npt.NDArray[np.int64]
"""Where something stands: rows, columns, samples."""

ROUNDING = 1e-9
"""Share of a size below which a difference is rounding: far above what sums lose, far below what matters."""


def block_columns(places: Places, width: int) -> list[int]:
    """The columns of blocks of `width` columns each that stand at these places."""
    columns: list[int] = (places[:, None] * width + np.arange(width)).ravel().tolist()
    return columns
