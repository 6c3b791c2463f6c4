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

import numpy as np
import scipy

from oed.estimation.methods.bands import banded, factor, whitened
from oed.estimation.methods.chain import Chain
from oed.estimation.methods.gauss_markov import GaussMarkov
from oed.estimation.methods.joint import JointSearch
from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.setup.noise import LEAST, Noise, group_of, groups
from oed.foundation.arrays import Array, Bools, Places

POSE = ("x", "y", "heading")
"""What errors are looked for in."""
MOST, FEWEST_OF_SEGMENT = 500, 8
"""Times of all logs together that are looked at, spread evenly, and how many of a segment all the same."""
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
        chosen, new = _spread_evenly(layout)
        segments = np.arange(layout.count)[:, None]
        rows = np.concatenate([found.residuals[..., None], found.slopes, found.own], axis=-1)[..., places, :]
        path = (layout.readings - found.residuals)[..., places[:2]]
        valid = layout.valid[..., places][segments, chosen] & new[..., None]
        return cls(
            replace(layout, times=layout.times[segments, chosen]),
            tuple(names),
            np.where(valid[..., None], rows[segments, chosen], 0.0),
            valid,
            path[segments, chosen],
            found.rates[1][segments, chosen],
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

    @cached_property
    def forms(self) -> Array:
        """Sums over each quantity's times of its rows' products, (k, S, 1 + q + c, 1 + q + c)."""
        return np.asarray(np.einsum("sikc,sikd->kscd", self.rows, self.rows))

    @cached_property
    def counts(self) -> Array:
        """How often each quantity is read, (k,)."""
        return np.asarray(self.valid.sum(axis=(0, 1)))

    @property
    def seconds(self) -> float:
        """Of the longest segment."""
        return float((self.layout.times[:, -1] - self.layout.times[:, 0]).max())


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
        return float(self.surprises(sizes[None]).item())

    def surprises(self, sizes: Array) -> Array:
        """Twice the negative logarithms (K,) of the restricted likelihood at several sizes (K, s), but for a
        constant: in one pass along the logs.
        """
        rest, chain = self.rest, Chain(*map(np.stack, zip(*map(self.chain, sizes), strict=True)))
        weights = sizes[:, rest.group] ** -2.0
        every = weights[:, None, None]
        own, below = chain.precision
        tried, count, times, side = own.shape[:4]
        places = np.arange(weights.shape[-1])
        own[..., places, places] += np.where(rest.valid, every, 0.0)
        root = factor(banded(own.reshape(-1, side, side), below.reshape(-1, side, side)[:-1]))
        pull = np.zeros((tried, count, times, side, rest.rows.shape[-1]))
        pull[..., places, :] = every[..., None] * rest.rows
        known = whitened(root, pull.reshape(-1, pull.shape[-1])).reshape(tried, count, times * side, -1)
        exact = np.tensordot(weights, rest.forms, axes=1)
        # What no start explains, and of that what no unknown does.
        fixed = 1 + len(rest.known)
        left, volumes = _eliminated(exact - known.swapaxes(-1, -2) @ known, exact, fixed)
        whole = left.sum(axis=1)
        whole[:, 1:, 1:] += rest.known
        squares, more = _eliminated(whole, whole, 1)
        volume = volumes.sum(axis=1) + more - chain.volume
        volume += 2 * np.log(root[0]).reshape(tried, -1).sum(axis=1)
        return np.asarray(squares[:, 0, 0] + volume - np.log(weights) @ rest.counts)

    def likeliest(self, begin: Array, bounds: Array, given: Array, enough: float) -> tuple[float, Array]:
        """The least `surprise`, and the logarithms of the first sizes that have it.

        Args:
            begin: logarithms of the first sizes where the search begins, (r,).
            bounds: the least and the most of each, (r, 2).
            given: logarithms of the other sizes.
            enough: relative change at which the search has arrived.
        """

        found = scipy.optimize.minimize(
            lambda logs: self.slope(logs, bounds[:, 1], given),
            begin,
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"ftol": enough},
        )
        return float(found.fun), np.asarray(found.x)

    def slope(self, logs: Array, most: Array, given: Array) -> tuple[float, Array]:
        """The `surprise` at logarithms of sizes, and its derivatives (r,) by the first of them.

        Args:
            logs: of the first sizes, (r,).
            most: of each; differences are taken on the side where there is room.
            given: of the others.
        """
        steps = np.where(logs + STEP > most, -STEP, STEP)
        values = self.each(np.vstack([logs, logs + np.diag(steps)]), given)
        return float(values[0]), (values[1:] - values[0]) / steps

    def each(self, logs: Array, given: Array) -> Array:
        """The `surprise` (K,) at logarithms of the first sizes (K, r) and of the others; `LEAST_LIKELY` where
        no number holds them.
        """
        return self._each(np.exp(np.hstack([logs, np.tile(given, (len(logs), 1))])))

    def _each(self, sizes: Array) -> Array:
        # One that no number holds leaves the others as they are.
        try:
            return self.surprises(sizes)
        except np.linalg.LinAlgError:
            if len(sizes) == 1:
                return np.array([LEAST_LIKELY])
            return np.concatenate([self._each(one[None]) for one in sizes])

    def greatest(self, after: Array | None = None) -> tuple[float, Array]:
        """Akaike's criterion of the sizes that make it greatest, and these.

        Args:
            after: sizes that much the same search found; the first guess by default.
        """
        begin = np.log([*self.rest.white.values(), *self.begin])
        spread = np.full(len(begin), SPREAD)
        spread[: len(self.rest.white)] *= not self.rest.specified

        bounds = np.column_stack([begin - spread, begin + spread])
        start = begin if after is None else np.clip(np.log(after), *bounds.T)
        least, logs = self.likeliest(start, bounds, np.zeros(0), ENOUGH)
        return least + 2 * len(begin), np.exp(logs)


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


def _spread_evenly(layout: SegmentLayout) -> tuple[Places, Bools]:
    # Places of the times that are looked at, both ends of each segment among them, (S, k), and which of them
    # are no repetition of the place before: short segments have fewer than k.
    count = min(layout.periods + 1, max(FEWEST_OF_SEGMENT, MOST // layout.count))
    places = np.rint(layout.last[:, None] * np.linspace(0.0, 1.0, count)).astype(int)
    return places, np.diff(places, axis=1, prepend=-1) > 0


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


def _eliminated(matrices: Array, exact: Array, kept: int) -> tuple[Array, Array]:
    # What is left of quadratic forms (..., m, m) in the first unknowns where the others fit best, and the
    # logarithms (...) of these others' determinants; `exact` are the forms of readings without other errors.
    own, across = matrices[..., kept:, kept:], matrices[..., kept:, :kept]
    scale = np.einsum("...ii->...i", exact)[..., kept:]
    size = np.sqrt(np.where(scale > 0, scale, 1.0))
    scaled = own / size[..., :, None] / size[..., None, :] + TINY * np.eye(own.shape[-1])
    across = across / size[..., None]
    left = matrices[..., :kept, :kept] - across.swapaxes(-1, -2) @ np.linalg.solve(scaled, across)
    return left, np.linalg.slogdet(scaled)[1] + 2 * np.log(size).sum(axis=-1)
