"""Listeners of searches that do something in the middle."""

from __future__ import annotations

from collections.abc import Callable


class Listener:
    """Counts the steps of a search and does something after one of them."""

    def __init__(self, after: int = -1, action: Callable[[], None] = lambda: None) -> None:
        self.after, self.action, self.steps, self.total = after, action, 0, 0

    def begin(self, description: str, total: int) -> None:
        self.total = total

    def advance(self, note: str = "") -> None:
        self.steps += 1
        if self.steps == self.after:
            self.action()


def interrupt() -> None:
    raise KeyboardInterrupt
