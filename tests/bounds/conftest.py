"""Of tests of what uses a search over positions, not of how near that comes."""

from __future__ import annotations

import pytest

from oed.bounds import planar


@pytest.fixture
def coarse_grids(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of the usual cells along each side: looser bounds in a fraction of the time."""
    monkeypatch.setattr(planar, "COARSE", 14)
    monkeypatch.setattr(planar, "FINE", 28)
