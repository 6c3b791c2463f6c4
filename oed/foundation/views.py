"""Registry of views: the cards, tables and figures by which people look at objects.

Objects stand on lower floors than what shows them, and imports go downwards only. So the package names the
module that makes each view; it is imported when the first such view is wanted, and enters its functions here.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Callable

    Maker = Callable[..., Any]

View = Literal["card", "table", "figure"]

_modules: dict[View, str] = {}
_makers: dict[tuple[View, type], Maker] = {}


def register(module: str, *views: View) -> None:
    """Name the module whose functions make views; it is imported when the first of them is wanted."""
    _modules.update(dict.fromkeys(views, module))


def makes(view: View, kind: type) -> Callable[[Maker], Maker]:
    """Mark the function that makes a view of the objects of a class, and of those that inherit from it."""

    def enter(function: Maker) -> Maker:
        _makers[view, kind] = function
        return function

    return enter


def make(view: View, subject: object, *arguments: Any) -> Any:
    """Return a view of an object.

    Args:
        view: which of its views.
        subject: object to show.
        arguments: further arguments of the function that makes it.

    Raises:
        TypeError: there is no such view of the object's class.
        UserMistake: as that function raises it.
    """
    if view in _modules:
        importlib.import_module(_modules[view])
    for kind in type(subject).__mro__:
        if (view, kind) in _makers:
            return _makers[view, kind](subject, *arguments)
    raise TypeError(f"there is no {view} of a {type(subject).__name__}")
