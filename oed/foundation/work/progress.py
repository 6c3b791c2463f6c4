"""How long work says how far it is, without knowing who listens."""

from __future__ import annotations

from typing import Protocol


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
