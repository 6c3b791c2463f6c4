"""Files read and written: only what is a file is, so much of it, nowhere but where it is meant; and names."""

from __future__ import annotations

import contextlib
import errno
import fnmatch
import os
import re
import secrets
import stat
import tempfile
import unicodedata
from collections.abc import Mapping
from itertools import islice
from pathlib import Path

from oed.foundation.errors import Failure, FileError, FileIssue, UserMistake
from oed.foundation.shown import shown, written
from oed.foundation.text import did_you_mean

ENDINGS = 55
"""Bytes that are left for what is added to a folder's name: `.interrupted-2`, `_0.db3`."""
LEADS_OUT = "a link that leads out of the folder"
"""What is wrong with a link."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""What is wrong with a place that was a good one when the work began."""
MOST_NAMES = 1000
"""Names of a folder that are compared with one that it has not."""
ENDING_ALIKE = 0.75
"""Closeness of two names that is more than that of their endings."""
MOST_FILE_BYTES = 256 * 2**20
"""Bytes of a file that is read; the largest records have a hundredth of it."""
PIECE = 2**16
"""Bytes that are read at once of a file of unknown size."""
SPECIAL = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
"""What is neither a file nor a folder, in words; the rest are devices."""

TAKEN = 255
"""Bytes of a file's name that every common file system takes."""
LONGEST = 180
"""Bytes of a name, so that there is room for endings."""
SEPARATORS = '/\\:*?"<>|'
"""What divides paths, or cannot stand in the name of a file on some system."""
DEVICES = frozenset(
    ("con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10)))
)
"""What Windows opens instead of a file of that name."""

_IDENTIFIER = re.compile(r"\w[\w.]*")


def read_bytes(file: str | Path, most: int = MOST_FILE_BYTES) -> bytes:
    """What a file holds. What is none is not even opened: pipes wait for ever, and devices never end.

    Raises:
        OSError: no such file, something else than a file, more than `most` bytes in it.
    """
    try:
        _require_file(os.stat(file))
        handle = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except ValueError:
        raise OSError(errno.EINVAL, "no file can have that name") from None
    with os.fdopen(handle, "rb") as opened:
        # Another one may have taken its place in between.
        found = os.fstat(handle)
        _require_file(found)
        data = opened.read(min(found.st_size, most) + 1)
        # What the system makes up as it is read has no size before.
        while len(data) <= most and (more := opened.read(PIECE)):
            data += more
    if len(data) > most:
        size = max(found.st_size, len(data))
        raise OSError(errno.EFBIG, f"expected at most {most / 1e6:.3g} MB, got {size / 1e6:.3g} MB")
    return data


def read_text(file: str | Path, encoding: str = "utf-8", most: int = MOST_FILE_BYTES) -> str:
    """The text that a file holds; every line ends in a line feed.

    Args:
        file: to be read.
        encoding: of its text.
        most: bytes that it may have.

    Raises:
        OSError: as `read_bytes` does.
        UnicodeDecodeError: it is not such text.
    """
    return read_bytes(file, most).decode(encoding).replace("\r\n", "\n").replace("\r", "\n")


def text_of(
    file: str | Path,
    refusal: type[FileError],
    encoding: str = "utf-8",
    most: int = MOST_FILE_BYTES,
    absent: str = "",
) -> str:
    """The text that a file holds, or an error in words.

    Args:
        file: to be read.
        refusal: the error to raise.
        encoding: of its text.
        most: bytes that it may have.
        absent: what to say where there is none; by default which file may have been meant.

    Raises:
        FileError: of that class: no such file, a folder, too large, no text.
    """
    try:
        return read_text(file, encoding, most)
    except FileNotFoundError:
        reason = absent or no_such_file(Path(file))
    except IsADirectoryError:
        reason = "expected a file, got a folder"
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        text = "cannot be read: not UTF-8 text; if it is text, save it as UTF-8"
        raise refusal([FileIssue(str(file), line, 0, "", text)]) from None
    except OSError as error:
        reason = f"cannot be read: {error.strerror}"
    raise refusal.about(file, reason)


def no_such_file(file: Path, beside: Path | None = None) -> str:
    """That there is none, and which one of its folder may have been meant; or that there is no folder.

    Args:
        file: that is not there.
        beside: one that is read along with it, and so was not meant.
    """
    if os.path.islink(file):
        return f"a link to {shown(os.readlink(file))}, which is not there"
    try:
        names = sorted(one.name for one in islice(os.scandir(file.parent), MOST_NAMES))
    except (OSError, ValueError):
        return f"no such file, nor a folder {shown(str(file.parent))}"
    names = [name for name in names if beside is None or file.parent / name != beside]
    found = fnmatch.filter(names, file.name) if set(file.name) & set("*?[") else []
    if found:
        return f"no such file, but {len(found)} that match, as {shown(found[0])}: give it without quotes"
    return f"no such file{did_you_mean(file.name, names, ENDING_ALIKE)}"


def special(path: Path) -> str:
    """What stands there, such as "a pipe", where it is neither a file nor a folder; else ""."""
    try:
        return _special(os.stat(path).st_mode)
    except (OSError, ValueError):
        return ""


def _require_file(found: os.stat_result) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    special = _special(found.st_mode)
    if special:
        raise OSError(errno.EINVAL, f"expected a file, got {special}")


def _special(mode: int) -> str:
    # What is no file, folder or link; "" of these.
    ordinary = stat.S_ISREG(mode) or stat.S_ISDIR(mode) or stat.S_ISLNK(mode)
    return "" if ordinary else SPECIAL.get(stat.S_IFMT(mode), "a device")


def write_text(path: Path, text: str) -> None:
    """Write text as UTF-8, as `write_bytes` does.

    Raises:
        UserMistake, Failure: as `write_bytes` does.
    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file under a temporary name, then rename: a reader never sees half a file.

    Raises:
        UserMistake: the folder cannot be written to, or something else than a file has that name.
        Failure: there is no room left for it.
    """
    require_replaceable(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = new_file(path.parent)
    except OSError as error:
        raise unwritten(f"{path.parent}: cannot write there", error) from None
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise unwritten(f"{path}: cannot be written", error) from None
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def new_file(folder: Path) -> tuple[int, Path]:
    """A new file under a temporary name, open, and where it is: read by whom new files are read by."""
    # Those of `tempfile` are private, and asking what others are would change it for other threads' files.
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
    while True:
        # A short name, for the file's own may be as long as names can be.
        path = folder / f".oed-{secrets.token_hex(8)}"
        with contextlib.suppress(FileExistsError):
            return os.open(path, flags, 0o666), path


def require_replaceable(path: Path, *, links: bool = False) -> None:
    """Make sure that a new file may take the place of what is there: pipes and devices are others'.

    Args:
        path: where the file goes.
        links: whether it may take the place of a link, too, as in a folder of the package's own.

    Raises:
        UserMistake: something is there that no file may take the place of.
    """
    try:
        mode = os.lstat(path).st_mode
    except (OSError, ValueError):
        # Nothing is there, or writing will show what is wrong.
        return
    if stat.S_ISLNK(mode) and not links:
        raise UserMistake(f"{path}: cannot be written: it is a link; name the file itself that it leads to")
    if _special(mode):
        raise UserMistake(f"{path}: cannot be written: {_special(mode)} is there, not a file; name another")


def write_files(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Write texts and other contents by file name, each as `write_bytes` does.

    Raises:
        UserMistake, Failure: as `write_text` does.
    """
    for name, content in files.items():
        write_bytes(folder / name, content.encode() if isinstance(content, str) else content)


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
        # Where work fails, no trace of it stays.
        for one in made:
            one.rmdir()
    except OSError as error:
        raise UserMistake(f"{named or folder}: cannot write there: {error.strerror}") from None


def require_short(place: Path, name: str) -> None:
    """Refuse a folder's name that has no room for what is added to it.

    Raises:
        UserMistake: it is too long.
    """
    size, most = len(os.fsencode(name)), TAKEN - ENDINGS
    if size > most:
        text = f"a name of {size} bytes, and files are named after it: expected at most {most}"
        raise UserMistake(f"{place}: cannot write there: {text}")


def inside(folder: Path, name: str) -> Path:
    """The file or folder of that name in `folder`, which no link takes elsewhere.

    Raises:
        UserMistake: no file may have that name, or a link leads out of the folder.
    """
    path = folder / name
    issue = name_issue(name, TAKEN)
    if issue or path.resolve().parent != folder.resolve():
        raise UserMistake(f"{path}: {issue or LEADS_OUT}")
    return path


def within(folder: Path, name: str) -> Path:
    """The file of that name, such as `figures/a.svg`, in `folder`, to which no link leads elsewhere.

    Where it is a link itself, it is that which a file takes the place of.

    Raises:
        UserMistake: no file may have that name, or a link on the way leads out of the folder.
    """
    *folders, last = Path(name).parts
    place = folder
    for part in folders:
        place = inside(place, part)
    issue = name_issue(last, TAKEN)
    if issue:
        raise UserMistake(f"{place / last}: {issue}")
    return place / last


def identifier_issue(name: object) -> str:
    """Why a robot's parameter, input or state cannot have that name; "" where it can."""
    if isinstance(name, str) and _IDENTIFIER.fullmatch(name) and len(name.encode()) <= LONGEST:
        return ""
    text = f"expected a name of letters, digits, underscores and dots, of at most {LONGEST} bytes"
    return f"{text}, got {written(name)}"


def name_issue(name: str, longest: int = LONGEST) -> str:
    """Why files cannot be named after `name`, of `longest` bytes at most; "" where they can."""
    if not name.strip():
        return "expected a name, got nothing"
    found = next((char for char in name if char in SEPARATORS or shown(char) != char), "")
    if found:
        return f"expected a name that files can have, without {shown(found)}, got '{shown(name)}'"
    if unicodedata.normalize("NFKC", name)[0] in ".-" or name[-1] in ". ":
        return f"expected a name that begins with no dot or dash and ends with no dot, got '{name}'"
    if name.partition(".")[0].strip().lower() in DEVICES:
        return f"expected a name that files can have on every system, got '{name}'"
    if len(name.encode()) > longest:
        return f"expected a name of at most {longest} bytes, got {len(name.encode())}"
    return ""


def file_stem(name: str) -> str:
    """The stem of the files of what has that name: itself, blanks as underscores.

    Raises:
        UserMistake: no file may have that name.
    """
    issue = name_issue(name)
    if issue:
        raise UserMistake(f"name: {issue}")
    return name.replace(" ", "_")
