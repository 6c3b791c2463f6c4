"""Numbers as JSON holds them: null where there is none."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum
from typing import Any

import numpy as np
from pydantic import BaseModel


def plain(value: Any, digits: int | None = None) -> Any:
    """A value as JSON holds it: arrays as lists, members of enumerations as their values, null where a
    number is not finite; numbers to so many decimals, None for all of them.
    """
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", by_alias=True)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray | np.generic):
        return plain((value if digits is None else np.round(value, digits)).tolist())
    if isinstance(value, Mapping):
        return {key: plain(entry, digits) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry, digits) for entry in value]
    if not isinstance(value, float):
        return value
    return None if not math.isfinite(value) else value if digits is None else round(value, digits)
