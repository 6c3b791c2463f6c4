"""Code of the user's own: loaded from where it stands, run with care, and named in files so that it is found.

Python knows a module by its name, so that of two files of one name it would give the first for both. Here
every folder is a package under a name that no other has. Its modules find each other in it, whether they say
`import sizes` or `from . import sizes`. Errors are said in words, and streams are not the program's.
"""

from __future__ import annotations

import builtins
import importlib
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from io import StringIO
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, get_args

from oed.foundation.files import read_bytes

PREFIX = "oed_own_"
"""Begins the names under which modules of the user's own are loaded."""
NEVER_OWN = frozenset({"oed", *sys.stdlib_module_names})
"""What modules import is not taken from their own folder under these names."""
INSTALLED = frozenset(("site-packages", "dist-packages"))
"""Folders of packages that Python itself finds."""
LONGEST = 300
"""Characters of an error that are shown."""


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
        families = " or ".join(f"oed.{kind.__name__}" for kind in get_args(family) or (family,))
        raise ValueError(f"{place} is no {noun}: expected a class that inherits from {families}")
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


def in_words(error: BaseException, longest: int = LONGEST) -> str:
    """An error that code of the user's own raises, on one line, with its own line in their file."""
    try:
        said = str(error)
    except Exception:
        # Even that is their code.
        said = ""
    words = " ".join(f"{type(error).__name__}: {said}".split())
    words = words if len(words) <= longest else f"{words[: longest - 3]}..."
    return words + _place(error)


def _place(error: BaseException) -> str:
    # The deepest line of a module that stands in a folder of the user's.
    frames = [
        (frame.f_code.co_filename, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if str(frame.f_globals.get("__name__")).startswith(PREFIX)
    ]
    return f" ({Path(frames[-1][0]).name}, line {frames[-1][1]})" if frames else ""


@contextmanager
def lent_streams() -> Iterator[None]:
    """While the user's code runs, standard output is standard error, and neither can be closed or taken away:
    what the program itself prints may be read by another.
    """
    lent: Any = _Lent(sys.stderr or StringIO())
    with redirect_stdout(lent), redirect_stderr(lent):
        yield


class _Lent:
    # A stream as it is, except that it stays open.
    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def close(self) -> None:
        pass

    def __enter__(self) -> _Lent:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def own_module(folder: Path, name: str) -> ModuleType | None:
    """The module `name` (dotted within packages) of a folder; None where the folder has none.

    It is loaded anew where a file that was read along with it has changed since.

    Raises:
        Exception: whatever the module itself raises.
    """
    place = folder.resolve()
    if name.partition(".")[0] == "oed" or _file_of(place, name) is None:
        return None
    return importlib.import_module(f"{_package_of(place)}.{name}")


def folder_of(name: str) -> tuple[str, Path | None]:
    """A loaded module's name as its own folder has it, and that folder; None for one of Python's own path."""
    package, _, own = name.partition(".")
    known = _packages.get(package)
    return (name, None) if known is None else (own, known.folder)


@dataclass(frozen=True)
class _Package:
    # A folder as a package, and what stood in its files as they were read.
    folder: Path
    sources: dict[str, bytes] = field(default_factory=dict)

    @property
    def changed(self) -> bool:
        return any(_content(file) != source for file, source in self.sources.items())


_packages: dict[str, _Package] = {}
"""Packages by their names; the newest of a folder last."""


def _package_of(folder: Path) -> str:
    known = [name for name, one in _packages.items() if one.folder == folder]
    if known and not _packages[known[-1]].changed:
        return known[-1]
    if _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)
    module = ModuleType(f"{PREFIX}{len(_packages)}")
    module.__path__ = [str(folder)]
    _packages[module.__name__] = _Package(folder)
    sys.modules[module.__name__] = module
    return module.__name__


def _content(file: str) -> bytes | None:
    try:
        return read_bytes(file)
    except OSError:
        return None


def _file_of(folder: Path, name: str) -> Path | None:
    stem = folder.joinpath(*name.split("."))
    choices = (stem / "__init__.py", stem.with_name(f"{stem.name}.py"))
    return next((file for file in choices if file.is_file()), None)


class _Finder(MetaPathFinder):
    """Finds the modules of such packages, and no others."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        package, _, name = fullname.partition(".")
        if package not in _packages or not path:
            return None
        file = _file_of(Path(path[0]), name.rpartition(".")[2])
        if file is None:
            return None
        return spec_from_file_location(fullname, file, loader=_Loader(fullname, str(file)))


_FINDER = _Finder()


class _Loader(SourceFileLoader):
    """Compiles what stands in the file: compiled files show a change by the second and the size only."""

    def get_code(self, fullname: str) -> CodeType:
        file = self.get_filename(fullname)
        source = read_bytes(file)
        _packages[fullname.partition(".")[0]].sources[file] = source
        code: CodeType = self.source_to_code(source, file)
        return code

    def exec_module(self, module: ModuleType) -> None:
        importing = _Importing(module.__name__.partition(".")[0])
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": importing}
        super().exec_module(module)


@dataclass(frozen=True)
class _Importing:
    # What `import` does in a package's modules: names of its folder first, as for a script that stands there.
    package: str

    def __call__(
        self,
        name: str,
        globals: Mapping[str, object] | None = None,  # noqa: A002
        locals: Mapping[str, object] | None = None,  # noqa: A002
        fromlist: Sequence[str] | None = None,
        level: int = 0,
    ) -> ModuleType:
        first = name.partition(".")[0]
        if level or first in NEVER_OWN or _file_of(_packages[self.package].folder, first) is None:
            return builtins.__import__(name, globals, locals, fromlist or (), level)
        found = builtins.__import__(f"{self.package}.{name}", globals, locals, fromlist or ())
        return found if fromlist else sys.modules[f"{self.package}.{first}"]
