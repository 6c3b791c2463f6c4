"""Whether errors of whole logs stay as large as they are, as those of readings do, or grow, as drift does.

The restricted likelihood of what logs leave decides: of what neither starts nor unknowns could explain
[Patterson, Thompson: Recovery of inter-block information when block sizes are unequal, 1971]. Errors that
last are states of a Markov chain beside the readings' white noise, so that a likelihood costs in proportion
to the readings' number [Rue, Held: Gaussian Markov random fields, 2005, section 2.4].
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy

from oed.estimation.methods.bands import banded, factor, whitened
from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.methods.joint import JointSearch
from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.setup.noise import LEAST, Noise, group_of, groups
from oed.foundation.arrays import Array, Bools

POSE = ("x", "y", "heading")
"""What errors are looked for in."""
MOST = 500
"""Times of all logs together that are looked at, spread evenly."""
RIGID = 1e-6
"""Least variance of a step, relative to that of what it shows in: precisions are to be finite."""
LEAST_LIKELY = 1e12
"""Of sizes so far from each other that no number holds both, -2 times the likelihood's logarithm."""
SPREAD = 7.0
"""How far the logarithm of a size may be from its first guess."""
PART = 0.1
"""First guess of the time that errors last, relative to the longest log's."""
SHORTEST = 0.1
"""Length and turn that the longest path is taken to have at least [m, rad]."""
ENOUGH = 1e-7
"""Relative change of the likelihood's logarithm at which its search has arrived."""
STEP = 1e-4
"""Of the likelihood's difference quotients, in logarithms of the sizes: rounding shows in smaller ones."""
CLEAR = 10.0
"""By how much Akaike's criterion has to be less for errors that last than for white noise."""
SHARES = (0.1, 0.3, 1.0)
"""Of the residuals' size, and of the first guess of their time, that errors which last may be: a likelihood
is so broad in both that it rises at one of them where it rises at all."""
TINY = 1e-12
"""Information that is none, relative to what exact readings would have."""


@dataclass(frozen=True)
class Remainder:
    """What a search leaves of readings, and what starts and unknowns could still explain.

    Attributes:
        layout: with x and y among its quantities.
        quantities: of x, y and heading those that are read, k.
        rows: residuals, then derivatives by the unknowns and by the segments' own starts, (S, n + 1, k,
            1 + q + c), SI; 0 where nothing is read.
        valid: where something is, (S, n + 1, k).
        path: predicted x and y, (S, n + 1, 2) [m].
        yaw_rates: without sign, (S, n + 1) [rad/s].
        known: of the unknowns from before, (q, q).
        white: noise that readings are first thought to have, by its names, SI.
        specified: whether they are known to have that.
    """

    layout: SegmentLayout
    quantities: tuple[str, ...]
    rows: Array
    valid: Bools
    path: Array
    yaw_rates: Array
    known: Array
    white: Mapping[str, float]
    specified: bool

    @classmethod
    def of(cls, search: JointSearch, values: Array, starts: Array, noises: Mapping[str, Noise]) -> Remainder:
        """Of no more times than are needed.

        Args:
            search: over segments of logs with positions.
            values: of the unknowns, (q,).
            starts: of the segments, (S, c).
            noises: that readings are first thought to have.
        """
        found, layout = search.linearised(values, starts), search.layout
        names = [name for name in POSE if name in layout.quantities]
        places = [layout.quantities.index(name) for name in names]
        every = max(1, -(-layout.times.size // MOST))
        rows = np.concatenate([found.residuals[..., None], found.slopes, found.own], axis=-1)
        path = (layout.readings - found.residuals)[..., places[:2]]
        valid = layout.valid[:, ::every, places]
        return cls(
            replace(layout, times=layout.times[:, ::every]),
            tuple(names),
            np.where(valid[..., None], rows[:, ::every, places], 0.0),
            valid,
            path[:, ::every],
            found.rates[1][:, ::every],
            search.known.information,
            {name: max(noises[name].at_rest, LEAST) for name in groups(names)},
            search.specified is not None,
        )

    @property
    def groups(self) -> tuple[str, ...]:
        """The noises' names."""
        return tuple(self.white)

    @property
    def group(self) -> list[int]:
        """Which of them each quantity has."""
        return [self.groups.index(group_of(name)) for name in self.quantities]

    @property
    def sizes(self) -> Array:
        """Root mean square of the residuals of each noise, SI."""
        found = []
        for number in range(len(self.groups)):
            own = [place for place, of in enumerate(self.group) if of == number]
            residuals = self.rows[..., own, 0][self.valid[..., own]]
            found.append(max(float(np.sqrt(np.mean(residuals**2))), LEAST))
        return np.array(found)

    @property
    def seconds(self) -> float:
        """Of the longest segment."""
        return float((self.layout.times[:, -1] - self.layout.times[:, 0]).max())


class Chain(NamedTuple):
    """States of segments at their times, each following from the one before.

    Attributes:
        first: precision of the first states, (m,).
        moves: how states follow, (S, n, m, m).
        added: precision of what is added on the way, (S, n, m).
    """

    first: Array
    moves: Array
    added: Array

    @property
    def precision(self) -> tuple[Array, Array]:
        """Blocks on the diagonal of the states' precision matrix and below it, (S, n + 1, m, m) each."""
        count, steps, side = self.added.shape
        own, below = np.zeros((2, count, steps + 1, side, side))
        weighted = self.added[..., None] * self.moves
        own[:, 0] += np.diag(self.first)
        own[:, :-1] += self.moves.swapaxes(-1, -2) @ weighted
        own[:, 1:] += self.added[..., None] * np.eye(side)
        below[:, :-1] = -weighted
        return own, below

    @property
    def volume(self) -> float:
        """Logarithm of its determinant."""
        return float(len(self.added) * np.log(self.first).sum() + np.log(self.added).sum())


class ErrorModel(ABC):
    """Errors beside white noise; the first sizes are the white noises'.

    Args:
        rest: what is to be explained.
    """

    def __init__(self, rest: Remainder) -> None:
        """Of a search's remainder."""
        self.rest = rest

    @property
    @abstractmethod
    def begin(self) -> Array:
        """First guess of the sizes but the white noises', SI."""

    @abstractmethod
    def chain(self, sizes: Array) -> Chain:
        """Errors of x, y and perhaps the heading."""

    def surprise(self, sizes: Array) -> float:
        """Twice the negative logarithm of the restricted likelihood, but for a constant."""
        rest, chain = self.rest, self.chain(sizes)
        weights = np.where(rest.valid, sizes[rest.group] ** -2.0, 0.0)
        own, below = chain.precision
        count, times, side = own.shape[:3]
        places = np.arange(weights.shape[-1])
        own[:, :, places, places] += weights
        root = factor(banded(own.reshape(-1, side, side), below.reshape(-1, side, side)[:-1]))
        pull = np.zeros((count, times, side, rest.rows.shape[-1]))
        pull[:, :, places] = weights[..., None] * rest.rows
        known = whitened(root, pull.reshape(-1, pull.shape[-1])).reshape(count, times * side, -1)
        exact = np.einsum("sikc,sik,sikd->scd", rest.rows, weights, rest.rows)
        # What no start explains, and of that what no unknown does.
        fixed = 1 + len(rest.known)
        left, volume = _eliminated(exact - known.swapaxes(1, 2) @ known, exact, fixed)
        whole = left.sum(axis=0, keepdims=True)
        whole[:, 1:, 1:] += rest.known
        squares, more = _eliminated(whole, whole, 1)
        volume += more + 2 * float(np.log(root[0]).sum()) - chain.volume
        return float(squares.item() + volume - np.log(weights[weights > 0]).sum())

    def greatest(self, after: Array | None = None) -> tuple[float, Array]:
        """Akaike's criterion of the sizes that make it greatest, and these.

        Args:
            after: sizes that much the same search found; the first guess by default.
        """
        begin = np.log([*self.rest.white.values(), *self.begin])
        spread = np.full(len(begin), SPREAD)
        spread[: len(self.rest.white)] *= not self.rest.specified

        def surprise(logs: Array) -> float:
            try:
                return self.surprise(np.exp(logs))
            except np.linalg.LinAlgError:
                return LEAST_LIKELY

        low, high = begin - spread, begin + spread
        found = scipy.optimize.minimize(
            surprise,
            begin if after is None else np.clip(np.log(after), low, high),
            method="L-BFGS-B",
            bounds=np.column_stack([low, high]),
            options={"ftol": ENOUGH, "eps": STEP},
        )
        return float(found.fun) + 2 * len(begin), np.exp(found.x)


class Lasting(ErrorModel):
    """A Gauss-Markov process of each quantity: sizes of white noises, of the processes, and their time.

    Args:
        rest: what is to be explained.
        names: of the noises that last, all by default.
    """

    def __init__(self, rest: Remainder, names: Sequence[str] | None = None) -> None:
        """Of a search's remainder."""
        super().__init__(rest)
        self.places = [place for place, name in enumerate(rest.groups) if names is None or name in names]

    @property
    def begin(self) -> Array:
        """As large as the residuals, for a part of the logs."""
        return np.array([*self.rest.sizes[self.places], PART * self.rest.seconds])

    @property
    def shows(self) -> bool:
        """Whether a guess of such errors is likelier than next to none, by a part of what a search has to
        find: a look, for a search takes a hundred times as long.
        """
        white, begin = np.array(list(self.rest.white.values())), self.begin
        none = self.surprise(np.concatenate([white, RIGID * begin[:-1], begin[-1:]]))
        guesses = [
            np.r_[np.full(len(begin) - 1, size), time] * begin for size, time in product(SHARES, SHARES)
        ]
        return min(self.surprise(np.concatenate([white, one])) for one in guesses) < none - CLEAR / 4

    def chain(self, sizes: Array) -> Chain:
        """Stationary from the first."""
        count = len(self.rest.groups)
        each = RIGID * sizes[:count] ** 2
        each[self.places] = sizes[count:-1] ** 2
        variances = each[self.rest.group]
        left = np.exp(-self.rest.layout.steps / sizes[-1])[..., None]
        added = variances * np.maximum(1 - left**2, RIGID)
        return Chain(1 / variances, left[..., None] * np.eye(len(variances)), 1 / added)

    def noise(self, sizes: Array) -> GaussMarkov:
        """In the form of readings' noise."""
        names, *further = self.rest.groups, *map(float, sizes)
        white = dict(zip(names, further, strict=False))
        lasting = dict(zip((names[place] for place in self.places), further[len(names) :], strict=False))
        return GaussMarkov(white, lasting, further[-1])


class Drift(ErrorModel):
    """Dead reckoning's random walk: sizes of the white noises, in any direction after 1 m [m], and of the
    heading after 1 m and after 1 rad of turning [rad].
    """

    @property
    def begin(self) -> Array:
        """As would make the residuals as large as they are."""
        rest = self.rest
        length, turned = self._longest, max(float(self._turned.sum(axis=1).max()), SHORTEST)
        each = dict(zip(rest.groups, map(float, rest.sizes), strict=True))
        size = each["position"]
        turn = max(size / length, each.get("heading", 0.0))
        return np.array([size / np.sqrt(length), turn / np.sqrt(length), turn / np.sqrt(turned)])

    def chain(self, sizes: Array) -> Chain:
        """None at the start; carried along the path."""
        along, by_path, by_turning = sizes[-3:] ** 2
        # A heading shows in positions by as much as the path is long.
        rigid = RIGID * sizes[self.rest.groups.index("position")] ** 2 / np.array([1, 1, self._longest**2])
        moves = along * self._lengths
        turns = by_path * self._lengths + by_turning * self._turned
        added = np.stack([moves, moves, turns], axis=-1) + rigid
        return Chain(1 / rigid, self._carried, 1 / added)

    @cached_property
    def _carried(self) -> Array:
        # An error of the heading turns the way that is still to come.
        moves = np.diff(self.rest.path, axis=1)
        found = np.broadcast_to(np.eye(3), (*moves.shape[:2], 3, 3)).copy()
        found[..., 0, 2], found[..., 1, 2] = -moves[..., 1], moves[..., 0]
        return found

    @cached_property
    def _lengths(self) -> Array:
        return np.asarray(np.linalg.norm(np.diff(self.rest.path, axis=1), axis=-1))

    @cached_property
    def _longest(self) -> float:
        return max(float(self._lengths.sum(axis=1).max()), SHORTEST)

    @cached_property
    def _turned(self) -> Array:
        rates = self.rest.yaw_rates
        return np.asarray(self.rest.layout.steps * (rates[:, 1:] + rates[:, :-1]) / 2)


def has_lasting_form(quantities: Sequence[str]) -> bool:
    """Whether errors of such readings may be compared with drift."""
    return {"x", "y"} <= set(quantities) <= set(POSE)


def bounded_errors(search: JointSearch, values: Array, noises: Mapping[str, Noise]) -> GaussMarkov | None:
    """The errors that last, if whole logs are likelier to have these than drift, or none; else None.

    Args:
        search: over whole logs.
        values: of the unknowns, (q,), near enough for what is left to be linear.
        noises: that shorter segments show.
    """
    rest = Remainder.of(search, values, search.first_starts(values), noises)
    # The wheels' heading is what drifts: where a measured one goes away from it, nothing shows which errs.
    lasting, drift = Lasting(rest, ("position",)), Drift(rest)
    if not lasting.shows:
        return None
    criterion, sizes = lasting.greatest()
    found = lasting.noise(sizes)
    # What lasts as long as the logs shows no bound.
    if found.seconds > rest.seconds or criterion > Lasting(rest, ()).greatest()[0] - CLEAR:
        return None
    return found if criterion < drift.greatest()[0] else None


def _eliminated(matrices: Array, exact: Array, kept: int) -> tuple[Array, float]:
    # What is left of quadratic forms (S, m, m) in the first unknowns where the others fit best, and the
    # logarithm of these others' determinants; `exact` are the forms of readings without other errors.
    own, across = matrices[:, kept:, kept:], matrices[:, kept:, :kept]
    scale = np.einsum("sii->si", exact)[:, kept:]
    size = np.sqrt(np.where(scale > 0, scale, 1.0))
    scaled = own / size[:, :, None] / size[:, None, :] + TINY * np.eye(own.shape[-1])
    across = across / size[..., None]
    left = matrices[:, :kept, :kept] - across.swapaxes(1, 2) @ np.linalg.solve(scaled, across)
    return left, float(np.linalg.slogdet(scaled)[1].sum() + 2 * np.log(size).sum())
