"""Arguments of public functions that are something else than they are to be, refused in words."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache, wraps
from numbers import Real
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from oed.foundation.errors import UserMistake
from oed.foundation.shown import written
from oed.foundation.text import did_you_mean

Given = ParamSpec("Given")
Result = TypeVar("Result")

HINTS: dict[tuple[str, str], str] = {
    ("Problem", "Study"): "; a study's problem is `study.problem`",
    ("Study", "Problem"): "; make one of a file with oed.load_study or of its text with oed.parse_study",
    ("Study", "str"): "; read one with oed.load_study",
    ("Study", "PosixPath"): "; read one with oed.load_study",
    ("System", "str"): "; make one, for instance oed.DifferentialDrive(wheel_radius='5 cm', track='30 cm')",
    ("Space", "str"): "; make one: oed.DesignSpace(duration='20 s')",
    ("Measurement", "str"): "; make one with its noise, "
    "for instance oed.Poses(noise={'position': '1 cm', 'heading': '1 deg'})",
    ("Limit", "str"): "; make one with its bounds, for instance oed.WheelSpeed(bounds='10 rad/s')",
    ("Path", "Record"): "; a record's folder is `record.folder`",
    ("Problem", "Record"): "; that of its study is oed.load_study(...).problem",
    ("Trajectory", "Solution"): "; a solution's drive is `solution.trajectory`",
    ("Trajectory", "NoneType"): "; a solution without a design has none",
    ("Trajectory", "ndarray"): "; make one of a table with oed.Trajectory.from_samples",
    ("Record", "str"): "; read one with oed.load_record",
}
"""What to do about what is often given instead, by the class expected and the one that came."""


_NAMES: dict[Any, str] = {
    str: "text",
    Literal: "text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    Path: "a path",
    Sequence: "a list",
    Iterable: "a list",
    Mapping: "keys and values",
}
"""What values of other annotations than classes of this package are called."""


DIGITS = 100
"""Of a whole number, at most: none of more is read from a study, a record or the command line."""
LEAST = {"seed": 0, "workers": 1, "nodes": 1, "drives": 1, "draws": 1}
"""Least values of counts, by their name, which is the same of all public functions and of `oed`."""


class WrongKind(UserMistake, TypeError):
    """An argument that is something else than it is to be."""


def kind_issue(value: object, kind: type) -> str:
    """Why a value is no object of a class, in words; "" where it is one."""
    return "" if isinstance(value, kind) else _refused(value, _a(kind.__name__), kind.__name__)


def _refused(value: object, expected: str, name: str) -> str:
    came = written(value) if isinstance(value, str | int | float | None) else _a(type(value).__name__)
    if isinstance(value, type):
        # A class where one of its objects is wanted.
        meant = any(one.__name__ == name for one in value.__mro__)
        came = f"the class {value.__name__}{f'; write {_call_of(value)}' if meant else ''}"
    return f"expected {expected}, got {came}{HINTS.get((name, type(value).__name__), '')}"


def _call_of(kind: type) -> str:
    fields = getattr(kind, "model_fields", None)
    whole = fields is not None and not any(one.is_required() for one in fields.values())
    return f"{kind.__name__}({'' if whole else '...'})"


def _a(name: str) -> str:
    return f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"


def require_count(what: str, value: object, least: int | None = 0) -> None:
    """Refuse an argument that is no whole number of at least so much.

    Args:
        what: the argument's name.
        value: what came.
        least: that it may be, None for any.

    Raises:
        WrongKind: it is none.
    """
    number = None if isinstance(value, bool) or not hasattr(value, "__index__") else value.__index__()
    reason = count_issue(number, least) or ("" if number is not None else "expected a whole number")
    if reason:
        raise WrongKind(f"{what}: {reason}, got {written(value)}")


def count_issue(number: int | None, least: int | None) -> str:
    """What was expected instead of a number; "" where it may be one of at least so much.

    Args:
        number: that came; None for what is no whole number.
        least: that it may be, None for any; what is no whole number may be that of none.
    """
    if number is not None and abs(number) >= 10**DIGITS:
        return f"expected a whole number of at most {DIGITS} digits"
    too_small = least is not None and (number is None or number < least)
    return f"expected a whole number of at least {least}" if too_small else ""


def real_array(what: str, value: Any) -> Any:
    """Return a copy of an argument as an array of real numbers.

    Args:
        what: the argument's name.
        value: what came.

    Raises:
        WrongKind: complex or masked values, values with a unit, or no numbers.
    """
    # Loaded by those who have arrays.
    import numpy as np

    reason = ""
    if hasattr(type(value), "units") or hasattr(type(value), "unit"):
        reason = "values with a unit; give plain numbers in SI units"
    elif np.ma.is_masked(value):
        reason = "masked values; fill them or leave them out"
    if reason:
        raise WrongKind(f"{what}: expected real numbers, got {reason}")
    try:
        array = np.asarray(value)
        if np.iscomplexobj(array):
            raise WrongKind(f"{what}: expected real numbers, got complex ones")
        return np.array(array, dtype=float)
    except WrongKind:
        raise
    except (TypeError, ValueError):
        raise WrongKind(f"{what}: expected an array of numbers, got {written(value)}") from None


def called_in_words(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """A public function that refuses in words calls without what it needs, or with what it does not know."""
    return _watched(function, lambda given: "")


def typed(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """A public function that refuses in words whatever is something else than its annotations say."""

    def issue(given: Mapping[str, object]) -> str:
        hints = _hints(function)
        reasons = ((name, _issue(value, hints[name])) for name, value in given.items() if name in hints)
        wrong = next((f"{name}: {reason}" for name, reason in reasons if reason), "")
        return wrong or _miscounted(given)

    return _watched(function, issue)


def _miscounted(given: Mapping[str, object]) -> str:
    counts = {name: value for name, value in given.items() if name in LEAST and isinstance(value, int)}
    found = ((name, count_issue(value, LEAST[name]), value) for name, value in counts.items())
    return next((f"{name}: {reason}, got {written(value)}" for name, reason, value in found if reason), "")


def _watched(
    function: Callable[Given, Result], issue: Callable[[Mapping[str, object]], str]
) -> Callable[Given, Result]:
    @wraps(function)
    def call(*arguments: Given.args, **keys: Given.kwargs) -> Result:
        reason = issue(_bound(function, arguments, keys))
        if reason:
            raise WrongKind(reason)
        return function(*arguments, **keys)

    return call


def _bound(function: Callable[..., Any], arguments: Sequence[object], keys: Mapping[str, object]) -> Any:
    signature = _signature(function)
    try:
        return signature.bind(*arguments, **keys).arguments
    except TypeError as error:
        names = [name for name in signature.parameters if name != "self"]
        strange = next((name for name in keys if name not in names), None)
        hint = did_you_mean(strange, names) if strange else f"; it takes {', '.join(names)}"
        raise WrongKind(f"{function.__qualname__.removesuffix('.__init__')}: {error}{hint}") from None


@lru_cache(maxsize=128)
def _signature(function: Callable[..., Any]) -> Any:
    # Loaded by the first call.
    from inspect import signature

    return signature(function)


_hints = lru_cache(maxsize=128)(get_type_hints)


def _issue(value: object, hint: Any) -> str:
    # Why a value is not what an annotation says, in words; "" where it is.
    if _fits(value, hint):
        return ""
    lists = [one for one in _choices(hint) if get_origin(one) in (Sequence, tuple)]
    if lists and isinstance(value, list | tuple):
        issues = ((place, _issue(entry, get_args(lists[0])[0])) for place, entry in enumerate(value))
        return next(f"entry {place}: {issue}" for place, issue in issues if issue)
    kinds = [get_origin(one) or one for one in _choices(hint)]
    kinds = [one for one in kinds if one is not NoneType and not (one is str and Path in kinds)]
    names = [_NAMES.get(one) or _a(one.__name__) for one in kinds]
    return _refused(value, " or ".join(dict.fromkeys(names)), kinds[0].__name__)


def _choices(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _fits(value: object, hint: Any) -> bool:
    choices = _choices(hint)
    if len(choices) > 1:
        return any(_fits(value, one) for one in choices)
    origin = get_origin(hint)
    if origin is Literal:
        return isinstance(value, str)
    if origin in (Sequence, tuple):
        if not isinstance(value, Sequence) or isinstance(value, str | bytes):
            return False
        return all(_fits(one, get_args(hint)[0]) for one in value)
    kind = os.PathLike if hint is Path else origin or hint
    if kind in (int, float):
        whole = hasattr(value, "__index__")
        return not isinstance(value, bool) and (whole or (kind is float and isinstance(value, Real)))
    if kind is Any or not isinstance(kind, type) or kind.__module__ == "numpy":
        # Whatever becomes an array.
        return True
    return isinstance(value, kind) and not (origin is not None and isinstance(value, str))
