"""Mistakes in a study's keys, collected so that all are reported at once."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager

from oed.equations.tree import ExpressionError
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.text import did_you_mean


class Issues(list[Issue]):
    """Mistakes below one key of a study.

    Args:
        key: path of that key.
    """

    def __init__(self, *key: str) -> None:
        """Begin without a mistake."""
        super().__init__()
        self.key = key

    def add(self, message: str, *key: str) -> None:
        """Add a mistake, by its path from this key."""
        self.append(Issue((*self.key, *key), message))

    @contextmanager
    def at(self, *key: str) -> Iterator[None]:
        """Add the mistake that a block raises as a ValueError, by its path from this key."""
        try:
            yield
        except ExpressionError as error:
            self.add(f"column {error.offset + 1}: {error.message}", *key)
        except ValueError as error:
            self.add(str(error), *key)

    def compare(
        self, entries: Collection[str], names: Collection[str], missing: str, unknown: str, *key: str
    ) -> None:
        """Add names of the system without an entry in the study, and entries without a name.

        Args:
            entries: names of the entries.
            names: names of the system.
            missing: message with a gap for a name that has no entry.
            unknown: message with a gap for the name of an entry.
            key: path of the entries, from this key.
        """
        for name in names:
            if name not in entries:
                self.add(missing.replace("{}", name), *key)
        for name in entries:
            if name not in names:
                self.add(unknown.replace("{}", name) + did_you_mean(name, names), *key, name)

    def check(self) -> None:
        """Refuse mistakes.

        Raises:
            ProblemError: there are any; all are listed.
        """
        if self:
            raise ProblemError(self)


def no_such(kind: str, names: Collection[str], name: str = "") -> str:
    """Return the message for a name that a system does not have.

    Args:
        kind: noun for what has names.
        names: names of the system.
        name: the name, for a proposal of what was meant; none by default.
    """
    return f"the system has no such {kind}; it has {', '.join(names) or 'none'}{did_you_mean(name, names)}"
