"""Are the parameters identifiable at all? Asked before a search, and answered in words.

A combination of parameters that no drive identifies is a null vector of the information of several random
drives together, the start states and all nuisances eliminated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.errors import Issue, NotFinite, ProblemError, TooLarge
from oed.kernel.dynamics.embedding import Embedding
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.measurement.information import Estimation
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.problem import Problem
from oed.kernel.scorer import full_information

DRIVES = 6
"""Random drives whose information is added up at most, and then those nearer to the ends of inputs' ranges:
what none of them identifies is taken for what no drive does.
"""
NEARER = 4
"""Factor by which more drives are tried near the ends: of several decades a drive sees one."""
DECADES = 8.0
"""Powers of ten by which inputs come near the ends of their ranges where other drives hide something."""
ANY = 1.0
"""Size of an input that nothing bounds, where no drive is designed, SI: any will do."""
STEP = 0.01
"""Change of the first parameter, relative to its nominal value, by which a combination is described."""
NEGLIGIBLE = 1e-5
"""Share of the largest change below which a parameter is not part of a combination."""


@dataclass(frozen=True)
class Ambiguity:
    """A combination of parameters that no drive identifies, as far as random ones tell.

    Attributes:
        changes: changes of the parameters, SI, that together change nothing that is measured.
        relative: changes as shares of the nominal values, where these are not 0.
    """

    changes: Mapping[str, float]
    relative: Mapping[str, float]

    def __str__(self) -> str:
        """Return the combination in words."""
        names = list(self.changes)
        if len(names) == 1:
            return f"{names[0]} changes nothing that is measured"
        phrases = [
            f"{name} by {100 * self.relative[name]:+.3g} %"
            if name in self.relative
            else f"{name} by {self.changes[name]:+.3g} (SI)"
            for name in names
        ]
        return (
            f"{', '.join(names[:-1])} and {names[-1]} cannot be identified separately: changing "
            f"{', '.join(phrases[:-1])} and {phrases[-1]} together changes nothing that is measured"
        )


def require_identifiable(problem: Problem) -> None:
    """Refuse a problem whose parameters no drive identifies.

    Raises:
        ProblemError: names every combination that is not identifiable, and what to do.
    """
    combinations = ambiguities(problem)
    if not combinations:
        return
    remedy = "Take one of them as known (leave it out of `estimate`), give a `prior`, or measure more."
    key = "measurement" if problem.estimate is None else "estimate"
    raise ProblemError([Issue((key,), f"{'; '.join(map(str, combinations))}. {remedy}")])


@typed
def ambiguities(problem: Problem, drives: int = DRIVES) -> tuple[Ambiguity, ...]:
    """Every combination of parameters that no drive of the space identifies, of those that the criterion
    judges; () if all is identifiable that it asks about.
    """
    rng = np.random.default_rng(0)
    roots, failed = list[dict[str, SquareRoot]](), list[NotFinite]()
    pairs = list[tuple[Estimation, SquareRoot]]()
    # What is over soon, or goes beyond all bounds, shows in next to none of the drives that are anywhere.
    only = problem.design.only
    for shares, count in ((_anywhere, drives), (_near_an_end, NEARER * drives)):
        tried = [_random_drive(problem, rng, shares) for _ in range(count)] if only is None else [only]
        for drive in tried:
            # Of drives that are finite: a system at its fastest may go beyond all bounds.
            try:
                roots.append(full_information(problem, drive))
            except NotFinite as error:
                failed.append(error)
                continue
            # What some drives identify, more of them do as well.
            pairs = _together(problem, roots)
            if _identified(problem, pairs):
                return ()
    # Drives whose readings are too large may identify what those left do not.
    too_large = [error for error in failed if isinstance(error, TooLarge)]
    if too_large or not roots:
        raise [*too_large, *failed][0]
    return tuple(
        ambiguity for estimation, root in pairs for ambiguity in _null_combinations(estimation, root)
    )


def _together(
    problem: Problem, roots: Sequence[Mapping[str, SquareRoot]]
) -> list[tuple[Estimation, SquareRoot]]:
    # What drives say together of what each sensor's block estimates.
    return [
        (estimation, SquareRoot.together([by_block[estimation.block.name] for by_block in roots]))
        for estimation in problem.any_estimations
    ]


def _identified(problem: Problem, pairs: Sequence[tuple[Estimation, SquareRoot]]) -> bool:
    scaled = [root.leading(len(estimation.judged)).scaled(estimation.scales) for estimation, root in pairs]
    return bool(problem.objective.identifiable(scaled))


def _null_combinations(estimation: Estimation, root: SquareRoot) -> list[Ambiguity]:
    sizes = np.where(estimation.nominal != 0, np.abs(estimation.nominal), 1.0)
    rows = _reduced((root.hidden / sizes[:, None]).T)
    judged = np.isin(estimation.parameters, estimation.judged)
    is_part = np.abs(rows) > NEGLIGIBLE * np.abs(rows).max(axis=1, keepdims=True, initial=0.0)
    # What only hides parameters that nobody asks for does no harm.
    touched = [place for place, row in enumerate(is_part) if row[judged].any()]
    touched.sort(key=lambda place: int(np.argmax(is_part[place])))
    return [_ambiguity(estimation, np.where(is_part[place], rows[place], 0.0), sizes) for place in touched]


def _reduced(rows: Array) -> Array:
    # Gauss-Jordan elimination: combinations of as few parameters as possible.
    rows = rows.copy()
    for index in range(len(rows)):
        rest = np.abs(rows[index:])
        pivot_row, pivot = divmod(int(np.argmax(rest)), rest.shape[1])
        rows[[index, index + pivot_row]] = rows[[index + pivot_row, index]]
        rows[index] /= rows[index, pivot]
        remaining = np.arange(len(rows)) != index
        rows[remaining] -= np.outer(rows[remaining, pivot], rows[index])
    return rows


def _ambiguity(estimation: Estimation, row: Array, sizes: Array) -> Ambiguity:
    chosen = np.flatnonzero(row)
    shares = row * (STEP / row[chosen[0]])
    names, nominal = estimation.parameters, estimation.nominal
    return Ambiguity(
        changes={names[index]: float(shares[index] * sizes[index]) for index in chosen},
        relative={
            names[index]: float(shares[index] * np.sign(nominal[index]))
            for index in chosen
            if nominal[index] != 0
        },
    )


def _anywhere(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    return rng.uniform(0.0, 1.0, shape)


def _near_an_end(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    # Of each input's range the same end all the time, as often a thousandth off it as a tenth.
    near = 10.0 ** -rng.uniform(0.0, DECADES, shape)
    return np.where(rng.uniform(size=shape[1:]) < 0.5, near, 1 - near)


def _random_drive(
    problem: Problem,
    rng: np.random.Generator,
    shares: Callable[[np.random.Generator, tuple[int, ...]], Array],
) -> Trajectory:
    # Inputs at shares of their ranges. Whether it keeps to the room does not matter here.
    space, ranges = problem.design, problem.input_bounds
    bounds = np.where(np.isfinite(ranges), ranges, [-ANY, ANY])
    embedding = Embedding(space, len(bounds))
    drawn = np.concatenate([np.zeros(0), *(shares(rng, (size, 1)).ravel() for size in embedding.sizes)])
    low, high = embedding.bounds(bounds).T
    coefficients = embedding.table(embedding.within((low + (high - low) * drawn)[None, :], bounds)[0])
    starts = problem.starts.states(rng.uniform(-1, 1, problem.starts.size))
    return space.trajectory(coefficients, starts)
