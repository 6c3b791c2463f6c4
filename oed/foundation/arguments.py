"""Arguments of public functions that are something else than they are to be, refused in words."""

from __future__ import annotations

from oed.foundation.errors import UserMistake
from oed.foundation.shown import written

HINTS: dict[tuple[str, str], str] = {
    ("Problem", "Study"): "; a study's problem is `study.problem`",
    ("Study", "Problem"): "; make one of a file with oed.load_study or of its text with oed.parse_study",
    ("Study", "str"): "; read one with oed.load_study",
    ("Study", "PosixPath"): "; read one with oed.load_study",
    ("Trajectory", "Solution"): "; a solution's drive is `solution.trajectory`",
    ("Trajectory", "NoneType"): "; a solution without a design has none",
    ("Trajectory", "ndarray"): "; make one of a table with oed.Trajectory.from_samples",
    ("Record", "str"): "; read one with oed.load_record",
}
"""What to do about what is often given instead, by the class expected and the one that came."""


class WrongKind(UserMistake, TypeError):
    """An argument that is something else than it is to be."""


def kind_flaw(value: object, kind: type) -> str:
    """Why a value is no object of a class, in words; "" where it is one."""
    if isinstance(value, kind):
        return ""
    article = "an" if kind.__name__[0] in "AEIO" else "a"
    came = written(value) if isinstance(value, str | int | float | None) else _a(type(value).__name__)
    hint = HINTS.get((kind.__name__, type(value).__name__), "")
    return f"expected {article} {kind.__name__}, got {came}{hint}"


def _a(name: str) -> str:
    return f"{'an' if name[0] in 'AEIOaeio' else 'a'} {name}"


def require_kind(what: str, value: object, kind: type) -> None:
    """Refuse an argument that is no object of a class.

    Args:
        what: the argument's name.
        value: what came.
        kind: its class.

    Raises:
        WrongKind: it is something else; says what to do where that is known.
    """
    flaw = kind_flaw(value, kind)
    if flaw:
        raise WrongKind(f"{what}: {flaw}")


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
    if number is None or (least is not None and number < least):
        bound = "" if least is None else f" of at least {least}"
        raise WrongKind(f"{what}: expected a whole number{bound}, got {written(value)}")
