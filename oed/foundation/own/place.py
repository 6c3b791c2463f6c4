"""Where a class stands: how files name it, so that it is found again."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType

from oed.foundation.own.code import in_words, lent_streams
from oed.foundation.own.modules import folder_of, own_module

INSTALLED = frozenset(("site-packages", "dist-packages"))
"""Folders of packages that Python itself finds."""


def class_at(place: str, folder: str | None, family: type, noun: str) -> type:
    """The class that "module:Class" names.

    Args:
        place: module and class.
        folder: where the module's file is looked for first; None for nowhere but on Python's path.
        family: the public class that it has to inherit from.
        noun: what classes of that family are, for errors.

    Raises:
        ValueError: no such module or class, a module that fails, a class of another family.
    """
    module_name, colon, name = place.partition(":")
    if not colon or not module_name or not name:
        raise ValueError(f"expected module:Class, got {place!r}")
    found = getattr(_module(module_name, folder), name, None)
    if found is None:
        raise ValueError(f"{module_name} has no {name}")
    if not isinstance(found, type) or not issubclass(found, family):
        raise ValueError(f"{place} is no {noun}: expected a class that inherits from oed.{family.__name__}")
    return found


def _module(name: str, folder: str | None) -> ModuleType:
    try:
        with lent_streams():
            own = None if folder is None else own_module(Path(folder), name)
            return importlib.import_module(name) if own is None else own
    except ModuleNotFoundError as error:
        if error.name != name.partition(".")[0]:
            raise ValueError(f"{name} cannot be imported: {error}") from None
        where = f"in {folder} and " if folder is not None else ""
        raise ValueError(f"no module {name} {where}on Python's path") from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        # A module that ends the program must not end this one as if all were well.
        raise ValueError(f"{name} cannot be imported: {in_words(error)}") from None


def place_of(found: type) -> tuple[str, str | None]:
    """("module:Class", folder) of a class; no folder where Python finds the module by itself."""
    module, folder = folder_of(found.__module__)
    file = getattr(sys.modules.get(found.__module__), "__file__", None)
    if folder is None and file is not None and module.partition(".")[0] != "oed":
        path = Path(file).resolve()
        if module == "__main__":
            module, folder = path.stem, path.parent
        elif INSTALLED.isdisjoint(path.parts):
            folder = path.parents[module.count(".") + (path.stem == "__init__")]
    return f"{module}:{found.__qualname__}", None if folder is None else str(folder)
