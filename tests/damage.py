"""Saved files damaged in every way that a key can be: missing, of another type, out of range, too short."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable, Iterator
from typing import Any

Key = tuple[str | int, ...]
EACH = 3
"""Entries of a list that are damaged: the first, the last and one between."""
EVIL = "../../evil"


def keys_of(value: Any, key: Key = ()) -> Iterator[Key]:
    """Every key of nested data, of long lists some of the places."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield (*key, name)
            yield from keys_of(inner, (*key, name))
    elif isinstance(value, list) and value:
        for place in sorted({0, len(value) // 2, len(value) - 1})[:EACH]:
            yield (*key, place)
            yield from keys_of(value[place], (*key, place))


def _deleted(parent: Any, part: str | int) -> None:
    del parent[part]


def _set(value: Any) -> Callable[[Any, str | int], None]:
    def damage(parent: Any, part: str | int) -> None:
        parent[part] = copy.deepcopy(value)

    return damage


def _shorter(parent: Any, part: str | int) -> None:
    if isinstance(parent[part], list | str | dict):
        parent[part] = parent[part][:-1] if not isinstance(parent[part], dict) else {}
    else:
        parent[part] = [parent[part]]


def _longer(parent: Any, part: str | int) -> None:
    value = parent[part]
    if isinstance(value, list) and value:
        value.append(copy.deepcopy(value[-1]))
    elif isinstance(value, dict):
        value["unheard_of"] = 1
    elif isinstance(value, str):
        parent[part] = f"{value}\x1b[31m $x^$ \u202e"
    else:
        parent[part] = str(value)


DAMAGES: dict[str, Callable[[Any, str | int], None]] = {
    "deleted": _deleted,
    "null": _set(None),
    "text": _set("nonsense"),
    "evil": _set(EVIL),
    "list": _set([]),
    "object": _set({}),
    "true": _set(True),
    "zero": _set(0),
    "negative": _set(-3),
    "huge": _set(1e300),
    "whole": _set(10**400),
    "nan": _set(math.nan),
    "shorter": _shorter,
    "longer": _longer,
}


def damaged(data: Any, key: Key, name: str) -> Any:
    """The data with one damage; all that is not on the way to it is the same as before."""
    found = copy.copy(data)
    *outer, last = key
    parent = found
    for part in outer:
        parent[part] = copy.copy(parent[part])
        parent = parent[part]
    parent[last] = copy.copy(parent[last])
    DAMAGES[name](parent, last)
    return found


def some(data: Any, count: int, seed: int) -> list[tuple[Key, str]]:
    """So many damages, drawn among all keys."""
    draw = random.Random(seed)
    keys = list(keys_of(data))
    return [(draw.choice(keys), draw.choice(list(DAMAGES))) for _ in range(count)]
