"""Files written whole or not at all."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from oed.errors import Failure, UserMistake

LONGEST = 255
"""Bytes of a file's name, at most, on every common file system."""
ENDINGS = 55
"""Of these, bytes that are left for what is added to a name: `.interrupted-2`, `_commands.json`."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""What is wrong with a place that was a good one when the work began."""


def write_text(path: Path, text: str) -> None:
    """Write text under a temporary name, then rename: a reader never sees half a file.

    Raises:
        UserMistake: the folder cannot be written to.
        Failure: there is no room left for it.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # A short name, for the file's own may be as long as names can be.
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".oed-")
    except OSError as error:
        raise unwritten(f"{path.parent}: cannot write there", error) from None
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
        # mkstemp makes files private; a report is to be read as any other file.
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, 0o666 & ~umask)
        os.replace(temporary, path)
    except OSError as error:
        Path(temporary).unlink(missing_ok=True)
        raise unwritten(f"{path}: cannot be written", error) from None
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def write_files(folder: Path, files: Mapping[str, str]) -> None:
    """Write texts by file name, each as `write_text` does.

    Raises:
        UserMistake, Failure: as `write_text` does.
    """
    for name, text in files.items():
        write_text(folder / name, text)


def unwritten(text: str, error: OSError) -> UserMistake | Failure:
    """The error for what could not be written: the user's mistake, unless there is no room left."""
    kind = Failure if error.errno in FULL else UserMistake
    return kind(f"{text}: {error.strerror or error}")


def require_writable(folder: Path, named: Path | None = None) -> None:
    """Make sure that files can be written into `folder`, before work is done that would be lost.

    Args:
        folder: which; it need not be there yet.
        named: what the user calls it.

    Raises:
        UserMistake: they cannot.
    """
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        # Work that fails leaves nothing behind.
        for one in made:
            one.rmdir()
    except OSError as error:
        raise UserMistake(f"{named or folder}: cannot write there: {error.strerror}") from None


def require_short(place: Path, name: str) -> None:
    """Refuse a name that leaves no room for what is added to it.

    Raises:
        UserMistake: it is too long.
    """
    flaw = length_flaw(name)
    if flaw:
        raise UserMistake(f"{place}: cannot write there: {flaw}")


def length_flaw(name: str) -> str:
    """What is wrong with the length of a name that files are named after; "" where nothing is."""
    size, most = len(os.fsencode(name)), LONGEST - ENDINGS
    return (
        f"a name of {size} bytes, and files are named after it: expected at most {most}"
        if size > most
        else ""
    )
