"""The example studies that come with the package: where they are, what they are called, what they need."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from oed.foundation.errors import Failure, UserMistake
from oed.foundation.files import read_bytes
from oed.foundation.text import did_you_mean
from oed.foundation.work.folders import updated
from oed.study.yaml_source import read_yaml

FOLDER = "problems"
"""Name of the folder of examples, and of their copy."""
SUFFIX = ".yaml"


@dataclass(frozen=True)
class Example:
    """A study that comes with the package.

    Attributes:
        name: of its file, without the suffix; `published/box_lucas` in a folder of its own.
        title: the study's own name.
        files: names relative to the folder of examples, its own first, then those of what it needs.
    """

    name: str
    title: str
    files: tuple[str, ...]


def examples_folder() -> Path:
    """The folder of examples: in an installed package, or beside it in a checkout.

    Raises:
        Failure: there is none.
    """
    package = Path(__file__).parents[1]
    for place in (package / FOLDER, package.parent / FOLDER):
        if place.is_dir():
            return place
    raise Failure(f"the example studies are missing, expected in {package / FOLDER}: install oed again")


def examples() -> dict[str, Example]:
    """Every example by its name, in alphabetical order, those of folders last."""
    folder = examples_folder()
    # Python keeps there what it has compiled.
    found = [one for one in folder.rglob("*") if one.is_file() and one.parent.name != "__pycache__"]
    names = sorted((one.relative_to(folder).as_posix() for one in found), key=lambda one: ("/" in one, one))
    beside = [name for name in names if not name.endswith(SUFFIX)]
    every = [_example(folder, name, beside) for name in names if name.endswith(SUFFIX)]
    return {one.name: one for one in every}


def _example(folder: Path, name: str, beside: Iterable[str]) -> Example:
    source = read_yaml(folder / name)
    # What a study needs is named in it, if only in the comment that says how to use it.
    needed = (one for one in beside if one in source.text)
    return Example(name.removesuffix(SUFFIX), source.data["name"], (name, *needed))


def examples_named(names: Iterable[str]) -> list[Example]:
    """The examples of these names, each once; a name may have the suffix of its file.

    Raises:
        UserMistake: names that none has; says which may have been meant.
    """
    known = examples()
    asked = list(dict.fromkeys(name.removesuffix(SUFFIX) for name in names))
    unknown = [f"no example study {name!r}{did_you_mean(name, known)}" for name in asked if name not in known]
    if unknown:
        raise UserMistake("\n".join([*unknown, "`oed examples` lists those that there are"]))
    return [known[name] for name in asked]


def copy_examples(chosen: Iterable[Example], out: Path, *, force: bool = False) -> dict[Path, bool]:
    """Copy examples with what they need into a folder, all or none; returns the copies.

    A file that is there already, and the same, stays: its value is false, that of a new one true.

    Args:
        chosen: examples.
        out: the folder; made where missing.
        force: whether files that are there may be written over.

    Raises:
        UserMistake: something else has the name of a copy, or the folder cannot be written to.
        Failure: there is no room left.
    """
    source = examples_folder()
    names = dict.fromkeys(name for one in chosen for name in one.files)
    contents = {name: read_bytes(source / name) for name in names}
    contents = {name: content for name, content in contents.items() if not _holds(out / name, content)}
    _require_free(out, contents, force)
    if contents:
        with updated(out) as draft:
            draft.write(contents)
            draft.publish()
    return {out / name: name in contents for name in names}


def _holds(path: Path, content: bytes) -> bool:
    try:
        return read_bytes(path) == content
    except OSError:
        return False


def _require_free(out: Path, names: Iterable[str], force: bool) -> None:
    odd = [place for name in names if (place := _in_the_way(out, name)) is not None]
    if odd:
        raise UserMistake(f"{odd[0]} is in the way, no file can go there; --out DIR copies elsewhere")
    taken = [out / name for name in names if os.path.lexists(out / name)]
    if taken and not force:
        more = f" and {len(taken) - 1} more exist" if len(taken) > 1 else " exists"
        raise UserMistake(f"{taken[0]}{more}; --out DIR copies elsewhere, --force writes over what is there")


def _in_the_way(out: Path, name: str) -> Path | None:
    # What has the name of a copy, or of a folder of it, and can be neither.
    folders = [out / one for one in reversed(Path(name).parents)]
    odd = [one for one in folders if os.path.lexists(one) and not one.is_dir()]
    if (out / name).is_dir():
        odd.append(out / name)
    return odd[0] if odd else None
