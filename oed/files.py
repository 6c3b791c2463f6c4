"""Files written whole or not at all, and nowhere but in the folder that is meant."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from oed.errors import UserMistake
from oed.names import name_flaw


def write_text(path: Path, text: str) -> None:
    """Write text under a temporary name, then rename: a reader never sees half a file.

    Raises:
        UserMistake: the folder cannot be written to.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise UserMistake(f"{path.parent}: cannot write there: {error.strerror}") from None
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
        raise UserMistake(f"{path}: cannot be written: {error.strerror}") from None
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def require_writable(folder: Path) -> None:
    """Make sure that files can be written into `folder`, before work is done that would be lost.

    Raises:
        UserMistake: they cannot.
    """
    fresh = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        if fresh:
            # Work that fails leaves nothing behind.
            folder.rmdir()
    except OSError as error:
        raise UserMistake(f"{folder}: cannot write there: {error.strerror}") from None


def inside(folder: Path, name: str) -> Path:
    """The file or folder of that name in `folder`, which no link takes elsewhere.

    Raises:
        UserMistake: no file may have that name, or a link leads out of the folder.
    """
    path = folder / name
    if name_flaw(name) or path.resolve().parent != folder.resolve():
        what = name_flaw(name) or "a link that leads out of the folder"
        raise UserMistake(f"{path}: {what}")
    return path
