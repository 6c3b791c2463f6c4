"""Equality of data that holds arrays: of all their numbers, where `==` of two arrays is an array."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


class ByValue:
    """A data class that is equal to another where all their fields are; of a class made with `eq=False`."""

    def __eq__(self, other: object) -> bool:
        """Whether the other is of the class, with equal fields, arrays number by number."""
        return equal(self, other) if type(other) is type(self) else NotImplemented

    __hash__ = None  # type: ignore[assignment]


def equal(one: Any, other: Any) -> bool:
    """Whether two values are equal, to the last bit of their arrays, in which NaN is equal to NaN."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return _equal_arrays(np.asarray(one), np.asarray(other))
    if type(one) is not type(other):
        return bool(one == other)
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(equal(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return len(one) == len(other) and all(map(equal, one, other))
    if is_dataclass(one) and not isinstance(one, type):
        compared = [each.name for each in fields(one) if each.compare]
        return all(equal(getattr(one, name), getattr(other, name)) for name in compared)
    return bool(one == other)


def _equal_arrays(one: np.ndarray[Any, Any], other: np.ndarray[Any, Any]) -> bool:
    numbers = all(np.issubdtype(each.dtype, np.inexact) for each in (one, other))
    return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=numbers)
