"""Locks on folders, which end with the process that holds them, however that ends."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import IO

from oed.foundation.errors import UserMistake
from oed.foundation.files import unwritten


@contextmanager
def held(hidden: Path, target: Path, *, wait: bool) -> Iterator[None]:
    """Hold the lock on a hidden folder, which is made for it and goes when it is empty.

    Args:
        hidden: it.
        target: the folder that it is hidden for, as the user knows it.
        wait: until the lock is free.

    Raises:
        UserMistake: another process holds it, if not to `wait`, or nothing can be written there.
    """
    fresh = [folder for folder in hidden.parents if not folder.exists()]
    try:
        with _locked(hidden, target, wait=wait):
            try:
                yield
            finally:
                with suppress(OSError):
                    # The lock's file goes last, while it is ours: who comes next makes one of its own.
                    (hidden / "holder").unlink()
                    hidden.rmdir()
    finally:
        # Work that fails stays without a trace.
        for folder in fresh:
            with suppress(OSError):
                folder.rmdir()


def _locked(hidden: Path, target: Path, *, wait: bool) -> IO[str]:
    while True:
        made(hidden, target)
        try:
            handle = _opened(hidden / "holder")
        except FileNotFoundError:
            continue
        except OSError as error:
            raise unwritten(f"{target}: cannot write there", error) from None
        if not _lock(handle, wait=wait):
            handle.seek(0)
            who = handle.read().strip() or "another process"
            handle.close()
            raise UserMistake(f"{target}: {who} is writing there; wait for it, or name another folder")
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle.fileno()), os.stat(hidden / "holder")):
                break
        # Its holder has just removed it.
        handle.close()
    _sign(handle.fileno())
    return handle


def _sign(holder: int) -> None:
    # At once: what waited in the handle would fail again when that is closed.
    since = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M:%S")
    text = f"process {os.getpid()} on {socket.gethostname()} (since {since})".encode()
    with suppress(OSError):
        os.ftruncate(holder, 0)
        if os.write(holder, text) < len(text):
            os.ftruncate(holder, 0)


def _opened(holder: Path) -> IO[str]:
    # Through no link, which would be somebody else's: what it leads to would be overwritten.
    for path in (holder.parent, holder):
        if path.is_symlink():
            raise UserMistake(f"{path}: a link where none is expected; remove it")
    return holder.open("a+", encoding="utf-8")


def _lock(handle: IO[str], *, wait: bool) -> bool:
    """Whether the lock on an open file is ours; where there are no locks, it is."""
    if sys.platform == "win32":
        return True
    import fcntl

    try:
        fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        # A file system without locks.
        return True
    return True


def made(path: Path, target: Path) -> None:
    """Make a folder.

    Args:
        path: it.
        target: what the user knows it by.

    Raises:
        UserMistake, Failure: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritten(f"{target}: cannot write there", error) from None
