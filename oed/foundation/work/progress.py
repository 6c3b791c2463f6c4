"""How long work says how far it is, without knowing who listens."""

from __future__ import annotations

from typing import Protocol, runtime_checkable


@runtime_checkable
class Progress(Protocol):
    """A listener to long work."""

    def begin(self, description: str, total: int) -> None:
        """A stage of `total` steps begins."""

    def advance(self, note: str = "") -> None:
        """One step is done; `note` says where things stand."""


class Silent:
    """Listens to nothing."""

    def begin(self, description: str, total: int) -> None:
        """Ignore the stage."""

    def advance(self, note: str = "") -> None:
        """Ignore the step."""


def announce(listener: Progress, sentence: str) -> None:
    """Tell a listener what cannot wait for the end, if it hears sentences: has a method `say`.

    Args:
        listener: to long work.
        sentence: for a reader.
    """
    say = getattr(listener, "say", None)
    if say is not None:
        say(sentence)


class Once:
    """Passes on all steps, and the first sentence alone."""

    def __init__(self, listener: Progress) -> None:
        """Keep who listens."""
        self.listener, self.said = listener, False

    def begin(self, description: str, total: int) -> None:
        """Pass on the stage."""
        self.listener.begin(description, total)

    def advance(self, note: str = "") -> None:
        """Pass on the step."""
        self.listener.advance(note)

    def say(self, sentence: str) -> None:
        """Pass on the first one."""
        if not self.said:
            self.said = True
            announce(self.listener, sentence)
