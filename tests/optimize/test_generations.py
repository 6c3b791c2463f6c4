"""The genetic algorithm on arrays: the same candidates as pymoo's own, drawn by the same random numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.duplicate import DefaultDuplicateElimination
from pymoo.core.population import Population
from pymoo.core.problem import Problem as PymooProblem
from pymoo.operators.mutation.gauss import GaussianMutation
from pymoo.termination import get_termination

from oed.foundation.arrays import Array
from oed.optimize import CmaEs, DifferentialEvolution, Genetic
from oed.optimize.generations import APART, OnArrays, known, repeated
from oed.optimize.genetic import PopulationSearch

SIZE, GENERATIONS = 5, 12


class Bowl(PymooProblem):
    """A sum of squares outside a ball and below a plane, to so many `digits`: with few, some are the same."""

    def __init__(self, digits: int = 15):
        super().__init__(n_var=SIZE, n_obj=1, n_ieq_constr=2, xl=-np.ones(SIZE), xu=np.linspace(1, 2, SIZE))
        self.digits, self.scored_sizes = digits, []

    def scored(self, candidates: Array) -> tuple[Array, Array]:
        self.scored_sizes.append(len(candidates))
        squares = (candidates**2).sum(axis=1)
        excess = np.column_stack([0.5 - squares, candidates.sum(axis=1) - 0.2])
        return -np.round(squares, self.digits), np.round(excess, self.digits)

    def _evaluate(self, x: Array, out: dict[str, Any], *_, **__):
        values, out["G"] = self.scored(x)
        out["F"] = -values[:, None]


def sampling(population: int, *, doubles: bool = False) -> Array:
    drawn = np.random.default_rng(5).uniform(-0.9, 0.9, (population, SIZE))
    if doubles:
        drawn[1::3] = drawn[0]
    return drawn


def both(options: Genetic, *, digits: int = 15, doubles: bool = False, seed: int = 3):
    """The search on arrays, and pymoo's, each with a problem of its own."""
    first = sampling(options.population, doubles=doubles)
    own, theirs = Bowl(digits), Bowl(digits)
    operators = options.operators(theirs)
    algorithm = GA(
        pop_size=options.population,
        sampling=first,
        crossover=operators.crossover,
        mutation=operators.mutation,
    )
    termination = get_termination("n_gen", options.generations)
    algorithm.setup(theirs, termination=termination, seed=seed, verbose=False)
    return options.begun(own, first, seed), algorithm, own, theirs


def assert_the_same(ours: OnArrays, algorithm: GA, own: Bowl, theirs: Bowl) -> int:
    """All generations; how many there were."""
    count = 0
    while algorithm.has_next():
        assert not ours.ended
        ours.advance()
        algorithm.next()
        unknowns, costs, excess, feasible = algorithm.pop.get("X", "F", "CV", "feas")
        np.testing.assert_array_equal(ours.standing.unknowns, unknowns)
        np.testing.assert_array_equal(ours.standing.costs, costs[:, 0])
        np.testing.assert_array_equal(ours.standing.violation, excess[:, 0])
        np.testing.assert_array_equal(ours.standing.feasible, feasible)
        assert ours.evaluations == algorithm.evaluator.n_eval
        count += 1
    assert ours.ended
    assert own.scored_sizes == theirs.scored_sizes
    return count


@pytest.mark.slow
@pytest.mark.parametrize("population", [4, 21, 40])
@pytest.mark.parametrize("mutation", ["polynomial", "gaussian"])
@pytest.mark.parametrize("crossover", ["sbx", "uniform", "two_point"])
def test_generations_are_pymoos(crossover: str, mutation: str, population: int):
    options = Genetic(population=population, generations=GENERATIONS, crossover=crossover, mutation=mutation)
    assert assert_the_same(*both(options)) == GENERATIONS


@pytest.mark.parametrize("digits", [0, 1])
@pytest.mark.slow
def test_where_candidates_are_equally_good(digits: int):
    # Pymoo lets a random number decide; each one more or less would change all that follow.
    options = Genetic(population=20, generations=GENERATIONS, crossover="uniform")
    assert assert_the_same(*both(options, digits=digits)) == GENERATIONS


@pytest.mark.slow
def test_where_candidates_come_twice():
    options = Genetic(population=21, generations=GENERATIONS, crossover="two_point")
    assert assert_the_same(*both(options, doubles=True)) == GENERATIONS


@pytest.mark.slow
def test_they_end_where_mating_gives_nothing_new():
    options = Genetic(population=4, generations=GENERATIONS)
    searches = both(options)
    for one in (searches[0], searches[1].mating):
        operators = one._operators if one is searches[0] else one
        operators.crossover.prob.set(0.0)
        operators.mutation.prob.set(-1.0)
    assert assert_the_same(*searches) == 2
    assert searches[2].scored_sizes == [4]


@pytest.mark.slow
@pytest.mark.parametrize("of", [Genetic, DifferentialEvolution])
def test_tightened_limits_are_those_of_the_candidates_too(of: type[PopulationSearch]):
    """What was feasible by 0.1 of a limit's size is feasible no more when that is tighter by more."""
    generations = of(population=20, generations=GENERATIONS).begun(Bowl(), sampling(20), 3)
    for _ in range(GENERATIONS // 2):
        generations.advance()
    before = generations.standing
    assert (before.feasible & (before.excess.max(axis=1) > -0.1)).any()
    generations.tighten(np.array([0.1, 0.0]))
    after = generations.standing
    np.testing.assert_allclose(after.excess - before.excess, [[0.1, 0.0]] * 20, atol=1e-15)
    np.testing.assert_array_equal(after.feasible, (before.excess <= [-0.1, 0]).all(axis=1))
    # What is selected next is selected by them.
    generations.advance()
    assert generations.standing.violation.sum() < after.violation.sum()


class TestGaussianMutation:
    """As pymoo's, but that the search's random numbers draw what it puts back within the bounds, too."""

    def mutated(self, mutation: GaussianMutation, spread: float) -> Array:
        candidates = np.random.default_rng(2).uniform(-spread, spread, (200, SIZE))
        mutation.prob_var = 0.4
        rng = np.random.default_rng(6)
        return np.array([mutation._do(Bowl(), candidates, random_state=rng), rng.random(candidates.shape)])

    def test_it_is_pymoos_where_nothing_leaves_the_bounds(self):
        own = self.mutated(Genetic(mutation="gaussian").operators(None).mutation, 0.1)
        np.testing.assert_array_equal(own, self.mutated(GaussianMutation(), 0.1))
        assert np.abs(own[0]).max() < 1

    def test_the_same_random_numbers_put_the_same_back(self):
        first, again = (self.mutated(Genetic(mutation="gaussian").operators(None).mutation, 1) for _ in "ab")
        np.testing.assert_array_equal(first, again)
        theirs = self.mutated(GaussianMutation(), 1)
        assert 0 < np.count_nonzero(first[0] != theirs[0]) < 100
        assert (first[0] >= -1).all()


@pytest.mark.slow
def test_cmaes_begins_about_the_gentlest_drive_of_the_sampling():
    gentlest = np.full(SIZE, -0.1)
    first = np.stack([np.full(SIZE, 0.9), gentlest, np.full(SIZE, -0.5)])
    generations = CmaEs(sigma=0.01).begun(Bowl(), first, seed=0)
    generations.advance()
    np.testing.assert_allclose(generations.standing.unknowns.mean(axis=0), gentlest, atol=0.05)


class TestSame:
    """By a weighted sum first: it must find what all distances would."""

    def near(self, apart: float) -> Array:
        base = np.random.default_rng(1).uniform(-1, 1, (30, SIZE)) * np.logspace(-3, 3, 30)[:, None]
        moved = base[::2].copy()
        moved[:, 2] += apart
        return np.concatenate([base, moved, base[:3], base[4][None, ::-1]])

    @pytest.mark.parametrize("apart", [0.0, APART / 2, APART, 2 * APART, 1e-14, 1e-3])
    def test_as_by_pymoo(self, apart: float):
        table = self.near(apart)
        pymoos = DefaultDuplicateElimination()
        kept = pymoos.do(Population.new(X=table)).get("X")
        np.testing.assert_array_equal(table[~repeated(table)], kept)
        assert len(kept) < len(table)
        others = Population.new(X=table[:25])
        new = pymoos.do(Population.new(X=table[20:]), others, to_itself=False).get("X")
        np.testing.assert_array_equal(table[20:][~known(table[20:], table[:25])], new)
        assert 0 < len(new) < 31

    def test_of_none(self):
        none = np.empty((0, SIZE))
        assert not known(sampling(4), none).any()
        assert repeated(none).shape == known(none, sampling(4)).shape == (0,)
