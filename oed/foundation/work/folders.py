"""Folders whose contents are replaced whole or not at all, by one process at a time.

What a folder is to hold is written into a hidden one beside it, its draft, and takes its place when it is
complete. What else stands in the folder stays in it. The lock on a draft ends with the process that holds it,
however that ends; what a killed process left half done is put in order by the next one that looks there.
"""

from __future__ import annotations

import logging
import os
import re
import shlex
import shutil
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from oed.foundation.errors import Failure, UserMistake
from oed.foundation.files import (
    LEADS_OUT,
    require_replaceable,
    require_short,
    require_writable,
    special,
    unwritten,
    within,
    write_files,
)
from oed.foundation.shown import shown
from oed.foundation.work.locks import held, made
from oed.foundation.work.signals import undisturbed

INSIDE = ".oed"
"""Name of what is hidden in a folder that has to stay where it is."""
INTERRUPTED = "interrupted"
"""What the name of a folder with a run that was cut short ends in."""


class Draft:
    """What a folder is to hold, in the making.

    Attributes:
        target: the folder, as it was named.
        path: the folder to write into until then.
    """

    def __init__(self, target: Path, home: Path, hidden: Path, *, in_place: bool, keep: bool) -> None:
        """A draft of `home`, the folder's own path, that is made in the folder `hidden`.

        It goes there file by file if `in_place`; is kept beside, where it is left early, if `keep`.
        """
        self.target = target
        self._home, self._hidden, self._in_place, self._kept = home, hidden, in_place, keep
        self.path = hidden / "draft" / home.name
        self._old, self._ready = hidden / "old", hidden / "ready"

    def write(self, files: Mapping[str, str | bytes]) -> None:
        """Write texts and other contents by file name.

        Raises:
            UserMistake: no file may have that name, it would go where a link in the folder leads, or a
                pipe or a device is there.
            Failure: there is no room left for them.
        """
        for name in files:
            require_replaceable(within(self.target, name), links=True)
        try:
            write_files(self.path, files)
        except (UserMistake, Failure) as error:
            # The user knows the folder, not its draft.
            raise type(error)(str(error).replace(str(self.path), str(self.target))) from None

    def adopt(self, folder: Path) -> None:
        """Take over a folder with all that it holds; it stays where it is, too."""
        _carry(folder, self.path / folder.name)

    def publish(self, drop: Collection[str] = (), *, carry: bool = True) -> Path:
        """Put what is written in its place; returns the folder.

        Args:
            drop: names of files, relative to the folder, that have no meaning beside what is written.
            carry: whether whatever else stands in the folder stays.

        Raises:
            UserMistake, Failure: it cannot be put there.
        """
        try:
            with undisturbed():
                if not self._home.exists():
                    os.replace(self.path, self._home)
                elif self._stays or not self._swapped(drop, carry):
                    self._moved_in(drop if carry else set(_names(self._home)))
        except OSError as error:
            raise unwritten(f"{self.target}: cannot be written", error) from None
        return self.target

    def discard(self) -> None:
        """Keep nothing of what is written."""
        shutil.rmtree(self.path, ignore_errors=True)

    def put_aside(self) -> Path | None:
        """Keep what is written beside the folder; returns where, None where nothing is."""
        if next(_names(self.path), None) is None:
            return None
        with undisturbed():
            return self._shown(_aside(self.path, self._hidden.parent / self._home.name))

    def put_in_order(self) -> Path | None:
        """Finish, or keep beside, what is left of a draft; returns where it is kept, None where it is not.

        The same for one that was left early and for that of a process that was killed: whatever moment that
        was, there is either the old folder, or the new one is complete.

        Raises:
            UserMistake: links where a draft has none: somebody else has put them there.
        """
        self._require_own()
        if self._ready.exists():
            _move_in(self._ready, self._home, ())
        if self._old.exists() and not self._home.exists():
            os.replace(self.path if self.path.exists() else self._old, self._home)
        shutil.rmtree(self._old, ignore_errors=True)
        kept = self.put_aside() if self._kept else None
        shutil.rmtree(self.path.parent, ignore_errors=True)
        return kept

    def _require_own(self) -> None:
        # Folders that come from elsewhere may come with what looks like a draft.
        for path in (self.path.parent, self._old, self._ready):
            if path.is_symlink():
                raise UserMistake(f"{path}: a link where none is expected; remove it")

    @property
    def _stays(self) -> bool:
        # What has been mounted, or is the working directory, cannot give way to another folder.
        return self._in_place or self._hidden.parent == self._home or _works_in(self._home)

    def _swapped(self, drop: Collection[str], carry: bool) -> bool:
        # The new folder is complete before the old one gives way: between two renames there is none.
        try:
            if carry:
                _carry(self._home, self.path, drop)
            _make_like(self._home, self.path)
            os.replace(self._home, self._old)
        except OSError:
            return False
        os.replace(self.path, self._home)
        shutil.rmtree(self._old, ignore_errors=True)
        return True

    def _moved_in(self, drop: Collection[str]) -> None:
        os.replace(self.path, self._ready)
        try:
            _move_in(self._ready, self._home, drop)
        except (OSError, UserMistake):
            # A folder where a file should go: what could not be moved is a draft again.
            os.replace(self._ready, self.path)
            raise

    def _shown(self, place: Path) -> Path:
        # As the user would name it.
        named = self.target.with_name(place.name) if self.target.name == self._home.name else place
        return named if named.exists() else place


@contextmanager
def drafted(folder: str | Path, *, keep: bool = True) -> Iterator[Draft]:
    """A draft of a folder to fill while the context lasts, and to publish: until then nothing is changed.

    One that is left without having been published is kept beside if `keep`, as FOLDER.interrupted; an error
    that leaves the context has a note where.

    Raises:
        UserMistake: the folder cannot be written to, or another process is writing there.
    """
    with _draft(Path(folder), "oed", in_place=False, keep=keep) as draft:
        try:
            yield draft
        except BaseException as error:
            kept = draft.put_in_order()
            if kept is not None:
                error.add_note(kept_in(kept))
            raise


@contextmanager
def updated(folder: str | Path) -> Iterator[Draft]:
    """A draft of some files of a folder, which go there one by one when they are published.

    For what can be made again at any time, such as a report; another process's turn is waited for.

    Raises:
        UserMistake: the folder cannot be written to.
    """
    with _draft(Path(folder), "pages", in_place=True, keep=False) as draft:
        yield draft


def require_usable(folder: str | Path) -> None:
    """Make sure that a folder can be written to, and things beside it be named after it, before work is done
    that would be lost.

    Raises:
        UserMistake: it cannot.
    """
    target = Path(folder)
    home = _home(target)
    require_short(target, home.name)
    if home.exists() and not home.is_dir():
        raise UserMistake(f"{target}: cannot write there: it is {special(home) or 'a file'}")
    require_writable(home, target)


def kept_in(folder: Path) -> str:
    """Where a run that was cut short is, in words."""
    command = shlex.join(["oed", "report", str(folder)])
    return f"what had been done by then is kept in {folder}: `{command}` makes its report"


def in_order(folder: str | Path) -> Path:
    """A folder to be read: one that a process was swapping when it was killed is there again."""
    path = Path(folder)
    if not path.exists():
        interrupted_runs(path)
    return path


def interrupted_runs(folder: str | Path) -> list[Path]:
    """The folders beside one that hold runs that were cut short, the newest last.

    What a killed process left half done there is put in order first.
    """
    target = Path(folder)
    home = _home(target)
    hidden = _hidden(home, "oed")
    if hidden.is_dir():
        # Where another process is at work, nothing is left half done.
        with suppress(UserMistake), drafted(target):
            pass
    named = re.compile(rf"{re.escape(home.name)}\.{INTERRUPTED}(?:-(\d+))?")
    found = {path: named.fullmatch(path.name) for path in _listed(hidden.parent)}
    numbers = {path: int(match[1] or 1) for path, match in found.items() if match is not None}
    draft = Draft(target, home, hidden, in_place=False, keep=True)
    return [draft._shown(path) for path in sorted(numbers, key=lambda path: numbers[path])]


@contextmanager
def _draft(target: Path, kind: str, *, in_place: bool, keep: bool) -> Iterator[Draft]:
    home = _home(target)
    require_usable(target)
    hidden = _hidden(home, kind)
    with held(hidden, target, wait=in_place):
        draft = Draft(target, home, hidden, in_place=in_place, keep=keep)
        found = _found(draft)
        if found is not None:
            text = shown(f"a run into {target} was killed; {kept_in(found)}")
            logging.getLogger(__name__).warning("%s", text)
        made(draft.path, target)
        try:
            yield draft
        finally:
            draft.put_in_order()


def _found(draft: Draft) -> Path | None:
    try:
        return draft.put_in_order()
    except OSError as error:
        raise unwritten(f"{draft.target}: cannot write there", error) from None


def _works_in(folder: Path) -> bool:
    try:
        return Path.cwd().resolve().is_relative_to(folder)
    except FileNotFoundError:
        return False


def _home(target: Path) -> Path:
    # A link to a folder stays one.
    return Path(os.path.realpath(target))


def _hidden(home: Path, kind: str) -> Path:
    # Beside the folder, which can then be swapped for another; inside where there is nothing beside it.
    fixed = home.is_dir() and (os.path.ismount(home) or not os.access(home.parent, os.W_OK))
    return (
        home / (INSIDE if kind == "oed" else f"{INSIDE}-{kind}")
        if fixed
        else (home.with_name(f".{home.name}.{kind}"))
    )


def _names(folder: Path) -> Iterator[str]:
    """Names, relative to a folder, of all that it holds; of folders in it only of empty ones."""
    for place, folders, files in os.walk(folder):
        if place == str(folder):
            folders[:] = [name for name in folders if not name.startswith(INSIDE)]
        here = Path(place)
        linked = [name for name in folders if (here / name).is_symlink()]
        yield from ((here / name).relative_to(folder).as_posix() for name in (*files, *linked))
        if not folders and not files and here != folder:
            yield here.relative_to(folder).as_posix()


def _carry(source: Path, target: Path, drop: Collection[str] = ()) -> None:
    """Give a folder all that another holds and it does not: links to the same files, not copies."""
    for name in _names(source):
        old, new = source / name, target / name
        if name in drop or os.path.lexists(new):
            continue
        for folder in reversed(Path(name).parents[:-1]):
            if not (target / folder).exists():
                (target / folder).mkdir(parents=True)
                _make_like(source / folder, target / folder)
        new.parent.mkdir(parents=True, exist_ok=True)
        _link(old, new)


def _link(old: Path, new: Path) -> None:
    if _is_folder(old):
        new.mkdir()
        return
    try:
        os.link(old, new, follow_symlinks=False)
    except OSError:
        # A file system without hard links, or somebody else's file.
        shutil.copy2(old, new, follow_symlinks=False)


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _make_like(folder: Path, other: Path) -> None:
    # Whom another folder belongs to, and who may use it.
    shutil.copymode(folder, other)
    with suppress(OSError, AttributeError):
        there = folder.stat()
        os.chown(other, there.st_uid, there.st_gid)


def _move_in(source: Path, target: Path, drop: Collection[str]) -> None:
    """Move all that a folder holds into another that stays.

    Raises:
        UserMistake: a link in it leads elsewhere; then nothing is moved.
    """
    names = list(_names(source))
    for name in names:
        if _leads_out(target, name):
            raise UserMistake(f"{target / Path(name).parts[0]}: {LEADS_OUT}")
    for name in drop:
        if not (source / name).exists() and not _leads_out(target, name):
            with suppress(FileNotFoundError, IsADirectoryError):
                (target / name).unlink()
    for name in names:
        old, new = source / name, target / name
        if _is_folder(old):
            new.mkdir(parents=True, exist_ok=True)
            continue
        new.parent.mkdir(parents=True, exist_ok=True)
        os.replace(old, new)
    shutil.rmtree(source, ignore_errors=True)


def _leads_out(folder: Path, name: str) -> bool:
    # Whether a link on the way to what has that name leads out of the folder.
    return not (folder / name).parent.resolve().is_relative_to(folder.resolve())


def _aside(folder: Path, beside: Path) -> Path:
    for number in count(1):
        place = beside.with_name(f"{beside.name}.{INTERRUPTED}" + (f"-{number}" if number > 1 else ""))
        if not os.path.lexists(place):
            break
    os.replace(folder, place)
    return place


def _listed(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:
        return []
