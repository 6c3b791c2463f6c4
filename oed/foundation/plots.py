"""Pictures of what is computed, without knowing who draws: objects ask here, and the room that draws answers.

Objects stand on lower floors than figures do, and imports go downwards only. So the package names the module
that draws; it is imported when a picture is first asked for, and enters here what it can draw.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    Draw = Callable[..., Any]

_modules: list[str] = []
_table: dict[type, Draw] = {}


def drawn_by(module: str) -> None:
    """Have a module's functions draw from now on; it is imported when the first picture is asked for."""
    if module not in _modules:
        _modules.append(module)


def draws(kind: type) -> Callable[[Draw], Draw]:
    """Marks the function that draws objects of a class, and of those that inherit from it."""

    def enter(function: Draw) -> Draw:
        _table[kind] = function
        return function

    return enter


def plot(subject: object, *arguments: Any) -> Any:
    """The figure (matplotlib's) of an object.

    Args:
        subject: what is shown.
        arguments: of the function that draws such objects.

    Raises:
        TypeError: nobody draws such objects.
        UserMistake: as that function raises it.
    """
    for module in _modules:
        importlib.import_module(module)
    for one in type(subject).__mro__:
        if one in _table:
            return _table[one](subject, *arguments)
    raise TypeError(f"there is no figure of a {type(subject).__name__}")
