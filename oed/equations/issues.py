"""Mistakes in a study's keys, collected so that all are reported at once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from oed.equations.tree import ExpressionError
from oed.foundation.errors import Issue, ProblemError


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

    def check(self) -> None:
        """Refuse mistakes.

        Raises:
            ProblemError: there are any; all are listed.
        """
        if self:
            raise ProblemError(self)
