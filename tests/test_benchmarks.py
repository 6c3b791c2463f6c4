"""What the benchmarks compare is comparable: programs of as many samples."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from benchmarks import solve
from benchmarks.figure import Figure
from benchmarks.plain import Plain
from oed.optimize.local import LocalSearch

SAMPLES = 620
"""So many that a search looks at fewer unless it is told otherwise."""


@pytest.fixture
def searched(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Samples of the searches that were built."""
    found: list[int] = []

    class Recorded(LocalSearch):
        def __init__(self, *args: object) -> None:
            super().__init__(*args)
            found.append(self.design.problem.design.samples)

    monkeypatch.setattr(solve, "LocalSearch", Recorded)
    return found


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch, searched: Sequence[int]) -> list[Figure]:
    """The table of one form, measured for as short a time as can be."""
    shortest = {"COMPARED": (SAMPLES,), "LONGER": (), "ITERATIONS": 1, "ENOUGH": 1, "REPEATED": 1}
    for name, value in shortest.items():
        monkeypatch.setattr(solve, name, value)
    monkeypatch.setattr(solve, "FORMS", {"segment": solve.FORMS["segment"]})
    monkeypatch.setattr(solve, "single_shooting", _immediate)
    monkeypatch.setattr(solve, "multiple_shooting", _immediate)
    return solve.figures()


def _immediate(*_: object) -> Plain:
    return Plain(Solver(), {})


class Solver:
    """Has nothing to do."""

    def __call__(self, **_: object) -> None:
        """Do it."""

    def stats(self) -> dict[str, int]:
        """No iteration."""
        return {"iter_count": 0}


@pytest.mark.slow
def test_plain_programs_are_compared_with_searches_on_as_many_samples(shown, searched):
    assert searched[0] == SAMPLES
    (compared,) = [one for one in shown if "shooting" in one.against]
    assert compared.what == f"segment form, N = {SAMPLES}: an Ipopt iteration"


@pytest.mark.slow
def test_what_a_coarse_grid_brings_has_a_row_of_its_own(shown, searched):
    assert searched[-2:] == [SAMPLES, 400]
    (saved,) = [one for one in shown if "on a grid of" in one.what]
    assert saved.what == f"segment form, N = {SAMPLES}, on a grid of 400: a search from one start"
    assert "on all samples" in saved.against
    assert "shooting" not in saved.against
