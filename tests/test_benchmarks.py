"""What the benchmarks compare is comparable: programs of as many samples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import casadi as ca
import numpy as np
import pytest

from benchmarks import __main__ as program
from benchmarks import solve, transcriptions, weights
from benchmarks.figure import Figure
from benchmarks.forms import problem_of
from benchmarks.mapped import Mapped
from benchmarks.plain import Plain
from benchmarks.staged import Staged
from benchmarks.stages import Stages
from oed.kernel.criteria import D
from oed.kernel.parts import budgets_of
from oed.optimize.ipopt import Ipopt
from oed.optimize.local import LocalSearch
from oed.optimize.weights import best_weights

SAMPLES = 620
"""So many that a search looks at fewer unless it is told otherwise."""


@pytest.fixture(scope="module")
def patch() -> Iterator[pytest.MonkeyPatch]:
    """What is changed for all tests."""
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.fixture(scope="module")
def searched(patch: pytest.MonkeyPatch) -> list[int]:
    """Samples of the searches that were built."""
    found: list[int] = []

    class Recorded(LocalSearch):
        def __init__(self, *args: object) -> None:
            super().__init__(*args)
            found.append(self.design.problem.design.samples)

    patch.setattr(solve, "LocalSearch", Recorded)
    return found


@pytest.fixture(scope="module")
def shown(patch: pytest.MonkeyPatch, searched: Sequence[int]) -> list[Figure]:
    """The table of one form, measured for as short a time as can be."""
    shortest = {"COMPARED": (SAMPLES,), "LONGER": (), "ITERATIONS": 1, "ENOUGH": 1, "REPEATED": 1}
    for name, value in shortest.items():
        patch.setattr(solve, name, value)
    patch.setattr(solve, "FORMS", {"segment": solve.FORMS["segment"]})
    patch.setattr(solve, "single_shooting", _immediate)
    patch.setattr(solve, "multiple_shooting", _immediate)
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


@cache
def staged_and_condensed() -> tuple[Staged, ca.DM, float]:
    """The program of stages, where it starts, and the optimum of the condensed one."""
    problem = problem_of("segment", 40)
    search = LocalSearch(problem, Ipopt(max_iterations=transcriptions.MOST, search_samples=100))
    z, known = transcriptions.start_of(search, 0), search.exchange.first_instants()
    chosen = search.exchange.chosen_rows(known, search.grid.trajectory(z))
    condensed = search.solve(search.program, z, search.grid.no_correction, chosen=chosen)
    instants = np.rint(np.unique(known.time) / problem.design.period).astype(int)
    staged = Staged(Stages(problem, instants, search.scale))
    # As many rows of the room as the condensed program has.
    assert staged.sides * sum(map(len, staged.stages.instants)) == len(known)
    return staged, z, condensed.maximised


@pytest.mark.slow
@pytest.mark.parametrize("way", ["by_ipopt", "by_fatrop"])
def test_stages_reach_the_optimum_of_the_condensed_program(way: str):
    if way == "by_fatrop" and not ca.has_nlpsol("fatrop"):
        pytest.skip("this CasADi has no fatrop")
    staged, z, optimum = staged_and_condensed()
    for plain in (
        getattr(staged, way)(staged.unrolled(), z, transcriptions.MOST),
        getattr(Mapped(staged, machine=False), way)(z, transcriptions.MOST),
    ):
        found = plain.solver(**plain.arguments)
        assert -float(found["f"]) == pytest.approx(optimum, rel=1e-6)


@pytest.mark.slow
def test_interior_points_and_classical_methods_agree(monkeypatch: pytest.MonkeyPatch):
    """To the gaps that the classical ones end at, on few candidates and after few steps."""
    monkeypatch.setattr(weights, "CANDIDATES", 21)
    monkeypatch.setattr(weights, "MOST", 1_000)
    shown = weights.figures()
    assert [one.what for one in shown] == [
        "D-optimal weights of 21 candidates, cubic regression: interior point"
    ] * len(weights.METHODS)
    parts = weights.candidates(21)
    best = best_weights(D(scaling="none"), parts, budgets_of(parts, 1.0))
    for method in weights.METHODS.values():
        assert 0 <= method(parts.rows) < 1e-2
    assert best.gradient.shape == (4, 4)


def test_one_that_fails_costs_only_its_own_figures(monkeypatch: pytest.MonkeyPatch, capsys):
    def alone(name: str) -> list[Figure]:
        if name == "drift":
            raise ValueError("no drift")
        return [Figure(name, "1 s", "2 s", 2.0)]

    monkeypatch.setattr(program, "_alone", alone)
    monkeypatch.setattr(program, "_write", lambda _: pytest.fail("half a table"))
    monkeypatch.setattr(program.sys, "argv", ["benchmarks", "--write"])
    assert program.main() == 1
    out, err = capsys.readouterr()
    assert "| solve | 1 s | 2 s | 2 |" in out
    assert "| weights | 1 s" in out
    assert err == "drift failed: ValueError('no drift')\n"
