"""The error tree: every error the package raises on purpose.

A `UserMistake` is something the caller can put right (exit code 2); a `Failure` is a run that could
not deliver (exit code 1). The command line turns either into one clear message, never a traceback.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from oed.foundation.shown import shown


class OedError(Exception):
    """Base of every error that `oed` raises on purpose."""


class UserMistake(OedError):
    """The input is wrong; the message says where, what was expected and what came."""


class Failure(OedError):
    """The input is sound but the work could not be done; the message says what is in the way."""


@dataclass(frozen=True)
class Issue:
    """One thing wrong with a problem: the key's path in the study, and a sentence about it."""

    key: tuple[str | int, ...]
    message: str

    def __str__(self) -> str:
        """`key.path: message`."""
        path = ".".join(str(part) for part in self.key)
        return shown(f"{path}: {self.message}" if path else self.message)


class ProblemError(UserMistake):
    """A design problem whose parts do not fit together; `issues` lists every reason at once."""

    issues: tuple[Issue, ...]

    def __init__(self, issues: Sequence[Issue]) -> None:
        """Keep the issues and join them into the message."""
        self.issues = tuple(issues)
        super().__init__("\n".join(str(issue) for issue in issues))

    @classmethod
    def about(cls, key: tuple[str | int, ...], message: str) -> Self:
        """An error of one issue, by its key in a study."""
        return cls([Issue(key, message)])


class PartError(ProblemError, ValueError):
    """A part, made in Python, whose arguments are not what they are to be: `issues` by class and name."""


class NotFinite(Failure):
    """A drive, or what is measured of it, whose numbers are no numbers; `issue` says which, and when."""

    def __init__(self, issue: Issue) -> None:
        """Keep the issue, which is the message."""
        self.issue = issue
        super().__init__(str(issue))

    def __reduce__(self) -> tuple[type[Self], tuple[Issue]]:
        """What pickles it by its issue, from the worker that met it."""
        return type(self), (self.issue,)


class TooLarge(NotFinite):
    """Readings of a drive, or their derivatives, whose squares are no numbers."""


@dataclass(frozen=True)
class FileIssue:
    """One thing wrong with a file: line and column from 1 (0 where there is none), key path, message."""

    file: str
    line: int
    column: int
    key: str
    message: str

    def __str__(self) -> str:
        """`file:line: key: message`."""
        place = f"{self.file}:{self.line}" if self.line else self.file
        return shown(": ".join(filter(None, (place, self.key, self.message))))


class FileError(UserMistake):
    """A file that cannot be used as it is; `issues` lists every reason at once."""

    issues: tuple[FileIssue, ...]

    def __init__(self, issues: Sequence[FileIssue]) -> None:
        """Keep the issues and join them into the message."""
        self.issues = tuple(issues)
        super().__init__("\n".join(str(issue) for issue in issues))

    @classmethod
    def about(cls, file: object, message: str, key: str = "") -> Self:
        """An error about a file as a whole, or about what a key of it names.

        Args:
            file: its name.
            message: what is wrong.
            key: that names it.
        """
        return cls([FileIssue(str(file), 0, 0, key, message)])


class StudyError(FileError):
    """A study file (YAML) with mistakes in it."""


class PathFileError(FileError):
    """A trajectory CSV that cannot be read."""


class RecordError(FileError):
    """A saved record that cannot be read."""


class LogError(FileError):
    """A robot's log that cannot be read or used."""
