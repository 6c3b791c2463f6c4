"""Modules of the user's own, loaded from where they stand: one module a file, whatever it is called.

Python knows a module by its name, so that of two files of one name it would give the first for both. Here
every folder is a package under a name that no other has. Its modules find each other in it, whether they say
`import sizes` or `from . import sizes`.
"""

from __future__ import annotations

import builtins
import importlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType

from oed.foundation.files import read_bytes

PREFIX = "oed_own_"
"""Begins the names under which modules of the user's own are loaded."""
NEVER_OWN = frozenset({"oed", *sys.stdlib_module_names})
"""What modules import is not taken from their own folder under these names."""


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
