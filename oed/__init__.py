"""Optimal experiment design for the kinematic calibration of mobile robots.

The public names are those of `__init__.pyi`; they are loaded when first used, so that importing `oed` (and
`oed --help`) costs nothing.
"""

import sys

import lazy_loader

from oed.foundation import moved

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """The class or function of a public name.

    Raises:
        AttributeError: there is none of this name; Python adds the most similar one.
    """
    if name not in __all__:
        new = moved.NAMES.get(name)
        hint = f": it is now {__name__}.{new}" if new else ""
        text = f"module {__name__!r} has no attribute {name!r}{hint}"
        raise AttributeError(text, name=name, obj=sys.modules[__name__])
    return _public(name)


moved.watch()
