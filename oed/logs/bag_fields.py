"""Numbers in the messages of a ROS bag by the path of their field: `wheel.left.velocity`, `data[2]`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator

from oed.foundation.component import Component
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean
from oed.logs.bag import Bag, Clock, series_of
from oed.logs.series import Series
from oed.logs.tables.columns import Short

_NAME = r"[A-Za-z_]\w*(\[\d+\])*"
_PATH = re.compile(rf"{_NAME}(\.{_NAME})*")


def _path(text: str) -> str:
    if _PATH.fullmatch(text):
        return text
    expected = "expected the path of a field, such as wheel.left.velocity or data[0]"
    raise ValueError(f"{expected}, got {written(text)}")


FieldPath = Annotated[str, AfterValidator(_path)]
"""Names with dots between, and indices from 0 of what has several entries."""


class NumberField(Component):
    """A field of a topic's messages that is a number.

    Attributes:
        field: its path, such as "state.x" or "data[0]".
        unit: e.g. "mm", "deg"; SI by default.
    """

    field: FieldPath
    unit: str | None = None


AnyNumberField = Annotated[NumberField, Short("field")]
_STEP = re.compile(r"[A-Za-z_]\w*|\[\d+\]")
QUATERNION = ("x", "y", "z", "w")


class _NotThere(Exception):
    """Why a path leads to nothing of its kind."""


@contextmanager
def refused(bag: Bag, topic: str, number: int, *named: str) -> Iterator[None]:
    """Paths that lead to nothing of their kind, refused by the message that they are looked for in.

    Args:
        bag: open.
        topic: of the message.
        number: of the message, from 1.
        named: path of the key in the study's key `log` that names the fields.

    Raises:
        LogError: there is such a path.
    """
    try:
        yield
    except _NotThere as error:
        raise bag.issue(topic, f"message {number}: {error}", *named) from None


def read_fields(
    bag: Bag, topic: str, paths: Sequence[str], clock: Clock, *named: str, turned: bool = False
) -> Series:
    """The numbers that stand at `paths` in every message of a topic, (n, numbers).

    Args:
        bag: open.
        topic: that is there.
        paths: of the fields.
        clock: that of the messages' headers, or of their recording.
        named: path of the key in the study's key `log` that names the fields.
        turned: whether the last path may be that of a quaternion: four numbers, x, y, z, w.

    Raises:
        LogError: no messages, and paths that lead to no number in one of them.
    """
    rows = []
    for number, time, message in bag.messages(topic, clock):
        with refused(bag, topic, number, *named):
            values = [number_in(message, path) for path in paths[: len(paths) - turned]]
            values += _numbers(message, paths[-1]) if turned else []
        rows.append((time, *values, number))
    if not rows:
        raise bag.issue(topic, "the topic has no messages", *named)
    return series_of(bag, topic, rows)


def _numbers(message: Any, path: str) -> list[float]:
    value = _at(message, path)
    if all(hasattr(value, name) for name in QUATERNION):
        return [float(getattr(value, name)) for name in QUATERNION]
    return [number_in(message, path)]


def number_in(message: Any, path: str) -> float:
    """The number at a path of a message, or of a part of one; see `refused`."""
    value = _at(message, path)
    if _is_number(value):
        return float(value)
    raise _NotThere(f"{path} is no number{_inside(value)}")


def id_in(message: Any, path: str) -> str:
    """The number or text at a path; see `refused`."""
    value = _at(message, path)
    if _is_number(value) or isinstance(value, str):
        return str(value)
    raise _NotThere(f"{path} is no id{_inside(value)}")


def items_in(message: Any, path: str) -> Sequence[Any]:
    """The list at a path; see `refused`."""
    value = _at(message, path)
    if _is_list(value):
        return list(value)
    raise _NotThere(f"{path} is no list{_inside(value)}")


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int | np.number) and not isinstance(value, bool)


def _at(message: Any, path: str) -> Any:
    value, passed = message, ""
    for step in _STEP.findall(path):
        value = _entry(value, passed, int(step[1:-1])) if step[0] == "[" else _field(value, passed, step)
        passed += step if step[0] == "[" or not passed else f".{step}"
    return value


def _field(value: Any, passed: str, name: str) -> Any:
    known = _fields(value)
    if name in known:
        return getattr(value, name)
    where = f"{passed or 'the message'} has no field {name}"
    if not known:
        raise _NotThere(f"{where}{_inside(value)}")
    raise _NotThere(f"{where}{did_you_mean(name, known) or ';'} it has {', '.join(known)}")


def _entry(value: Any, passed: str, index: int) -> Any:
    if not _is_list(value):
        raise _NotThere(f"{passed} has no entries, of which [{index}] would be one{_inside(value)}")
    if index >= len(value):
        raise _NotThere(f"{passed} has {len(value)} entries, from [0] on; there is no [{index}]")
    return value[index]


def _inside(value: Any) -> str:
    # What there is instead.
    if _is_list(value):
        return f": it has {len(value)} entries; say which, e.g. [0]"
    known = _fields(value)
    return f": it has {', '.join(known)}" if known else f", but {type(value).__name__}"


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple | np.ndarray)


def _fields(value: Any) -> list[str]:
    return [name for name in getattr(value, "__dataclass_fields__", {}) if not name.startswith("__")]
