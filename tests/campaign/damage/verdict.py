"""What a command may make of a damaged file.

It ends with 0, 1 or 2, in time and within memory, without a traceback; it writes nowhere but where it was
told to. Exit code 0 says that all is well: then its numbers are those of the sound file, or it said something
that it does not say of the sound one, or the damage is none that a reader could see: the file is as strictly
formed as before, with other values in it.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import yaml

from ..cases import MEMORY, SECONDS, Verdict, place_of
from .running import Ran

SAME = 1e-6
"""Share by which numbers of a sound and a damaged file may differ and be the same."""
SANE = 1e12
"""SI number beyond which nothing of a robot can be."""
TIMES = {"seconds", "wall_seconds", "finished", "peak", "stages", "history", "directory", "export", "file"}
"""Keys of outputs that differ from run to run."""
TYPES: tuple[tuple[type, ...], ...] = ((bool,), (int, float), (str,), (dict,), (list,), (type(None),))


def manners(ran: Ran) -> Iterator[Verdict]:
    """How it ended, whatever it said."""
    late = ran.code is None or ran.seconds > SECONDS
    yield Verdict("no hang", f"not ended after {ran.seconds:.0f} s" if late else "")
    yield Verdict("no traceback", place_of(ran.raised) if ran.raised else "")
    code = "" if late or ran.code in (0, 1, 2) else f"{ran.code}"
    silent = bool(ran.code) and not ran.raised and not ran.err.strip()
    yield Verdict("exit code 0, 1 or 2, and why", code or ("not a word" if silent else ""))
    yield Verdict("memory below 2 GB", f"{ran.peak / 2**30:.1f} GB" if ran.peak > MEMORY else "")
    odd = {sign for sign in ran.out + ran.err if ord(sign) < 32 and sign not in "\n\t\r"}
    yield Verdict("no control characters", f"{odd} on the terminal" if odd else "")


def taken_for_right(sort: str, sound: bytes, damaged: bytes, before: Ran, after: Ran) -> Verdict:
    """Whether a damaged file passed for a sound one: exit code 0, other numbers, and not a word."""
    asked = "damage is not taken for right"
    if after.code != 0 or before.code != 0 or same(_numbers(before.out), _numbers(after.out)):
        return Verdict(asked)
    if _said_more(before, after) or as_strict(sort, sound, damaged):
        return Verdict(asked)
    return Verdict(asked, "exit code 0 with other numbers, and nothing said of the damage")


def _numbers(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def same(one: Any, other: Any) -> bool:
    """Whether two outputs agree, but for times and places."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        keys = (set(one) | set(other)) - TIMES - {"study", "study_text", "provenance", "message"}
        return all(key in one and key in other and same(one[key], other[key]) for key in keys)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (one, other))
    if numbers:
        return math.isclose(one, other, rel_tol=SAME, abs_tol=1e-12)
    return bool(one == other)


def _said_more(before: Ran, after: Ran) -> bool:
    said = set(after.err.split("\n")) - set(before.err.split("\n")) - {""}
    return bool(said or _findings(_numbers(after.out)) - _findings(_numbers(before.out)))


def _findings(tree: Any) -> Counter[str]:
    # Names of what was found in a file, or the notes on it, and how often.
    found = Counter[str]()
    for key, value in tree.items() if isinstance(tree, Mapping) else ():
        if key in ("findings", "notes", "repairs", "issues") and isinstance(value, list):
            found.update(str(one["name"]) if isinstance(one, Mapping) else str(one) for one in value)
        found += _findings(value)
    for value in tree if isinstance(tree, list) else ():
        found += _findings(value)
    return found


def as_strict(sort: str, sound: bytes, damaged: bytes) -> bool:
    """Whether a file is formed as strictly as the sound one, its values aside."""
    try:
        if sort in ("path", "log"):
            return _strict_table(sound, damaged, whole=sort == "path")
        read = yaml.safe_load if sort == "study" else json.loads
        return _alike(read(sound), read(damaged.decode("utf-8")), optional=sort == "study")
    except Exception:
        return False


def _strict_table(sound: bytes, damaged: bytes, *, whole: bool) -> bool:
    first = sound.decode("utf-8").splitlines()[0].split(",")
    rows = [line.split(",") for line in damaged.decode("utf-8").splitlines()]
    if sorted(rows[0]) != sorted(first) or any(len(row) != len(first) for row in rows):
        return False
    body = rows[1:]
    if whole and not _closed(body):
        return False
    cells = [cell for row in body for cell in row]
    numbers = [float(cell) for cell in cells if cell]
    empty = sum(not cell for cell in cells)
    return (
        all(abs(value) < SANE for value in numbers)
        and all(cell.isascii() and "_" not in cell for cell in cells)
        and empty == sum(not cell for line in sound.decode().splitlines() for cell in line.split(","))
    )


def _closed(body: list[list[str]]) -> bool:
    # The last row of a path has the final pose and no inputs.
    return bool(body) and "" in body[-1]


def _alike(one: Any, other: Any, *, optional: bool) -> bool:
    # The same keys (some of a study's may be missing, for they have defaults) and types, numbers that can be.
    if isinstance(one, dict) and isinstance(other, dict):
        if not set(other) <= set(one) or (not optional and set(other) != set(one)):
            return False
        return all(_alike(one[key], other[key], optional=optional) for key in other)
    if isinstance(one, list) and isinstance(other, list):
        pairs = zip(one, other, strict=False)
        return (optional or len(one) == len(other)) and all(_alike(a, b, optional=optional) for a, b in pairs)
    if optional and other is None:
        # Left out, as a study may write it.
        return True
    quantities = ((int, float, str), (int, float, str))
    if optional and not isinstance(other, bool) and all(map(isinstance, (one, other), quantities)):
        return not isinstance(other, int | float) or _sane(other)
    types = [next(sort for sort in TYPES if type(value) in sort) for value in (one, other)]
    return types[0] == types[1] and (types[0] != (int, float) or _sane(other))


def _sane(value: float) -> bool:
    return math.isfinite(value) and abs(value) < SANE
