"""Where drives began that were read by sensors which see points of the room, and by no poses.

Every stretch of a log is driven by dead reckoning from many starts; from the best of them its start is found
by damped least squares, and with it the state in which each of its segments begins.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from oed.foundation.arrays import Array, Bools

TURNS, RING = 8, 0.7
"""Directions that are tried, and the distance of places from the middle of the points seen, in theirs."""
KEPT, STEPS = 4, 25
"""Starts that are followed, and steps of each at most."""
CLOSE, HOPELESS = 1e-3, 1e6
"""Share of the misfit that a last step gains, and damping at which there is nothing to gain."""
POSE = 3

Misfit = Callable[[Array], Array]
"""Of starts (S, states) the residuals in units of their noise, 0 where nothing was read, (S, K)."""
Slopes = Callable[[Array], Array]
"""Their derivatives by the starts, (S, K, states)."""


def located(misfit: Misfit, slopes: Slopes, starts: Array, points: Array) -> Array:
    """Starts (S, states) of least squares, the poses among them searched for.

    Args:
        misfit: of starts.
        slopes: of that.
        starts: with the states after the pose as they shall be, (S, states).
        points: that are seen, (k, 2) [m].
    """
    first = [_placed(starts, *pose) for pose in _guesses(points)]
    costs = np.array([_cost(misfit(one)) for one in first])
    best, least = starts.copy(), np.full(len(starts), np.inf)
    for rank in range(KEPT):
        chosen = np.argsort(costs, axis=0)[rank]
        begin = np.array([first[guess][row] for row, guess in enumerate(chosen)])
        found, cost = _followed(misfit, slopes, begin)
        better = cost < least
        best[better], least[better] = found[better], cost[better]
    return best


def _guesses(points: Array) -> list[tuple[float, float, float]]:
    middle = points.mean(axis=0)
    size = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean())) or 1.0
    turns = 2 * np.pi * np.arange(TURNS) / TURNS
    around = [middle + RING * size * np.array([np.cos(at), np.sin(at)]) for at in turns]
    return [(x, y, heading) for (x, y), heading in product([middle, *around], turns)]


def _placed(starts: Array, x: float, y: float, heading: float) -> Array:
    found = starts.copy()
    found[:, :POSE] = x, y, heading
    return found


def _cost(residuals: Array) -> Array:
    # What is far off counts little: a start near the right one shall win.
    return np.asarray(np.log1p(residuals**2).sum(axis=1))


def _followed(misfit: Misfit, slopes: Slopes, starts: Array) -> tuple[Array, Array]:
    # Levenberg and Marquardt, all segments at once, each with a damping of its own.
    damping, left = np.full(len(starts), 1e-2), misfit(starts)
    cost = (left**2).sum(axis=1)
    for _ in range(STEPS):
        own = slopes(starts)[..., :POSE]
        square, pull = np.einsum("ska,skb->sab", own, own), np.einsum("ska,sk->sa", own, left)
        sizes = damping[:, None] * np.einsum("saa->sa", square) + 1e-9
        tried = starts.copy()
        tried[:, :POSE] -= np.linalg.solve(square + sizes[..., None] * np.eye(POSE), pull[..., None])[..., 0]
        after = misfit(tried)
        now = (after**2).sum(axis=1)
        better: Bools = now < cost
        gained = np.where(better, 1 - now / np.maximum(cost, 1e-300), 0.0)
        starts, left = np.where(better[:, None], tried, starts), np.where(better[:, None], after, left)
        cost, damping = np.where(better, now, cost), np.where(better, damping / 5, damping * 5)
        if np.all(better & (gained < CLOSE)) or damping.min() > HOPELESS:
            break
    return starts, cost
