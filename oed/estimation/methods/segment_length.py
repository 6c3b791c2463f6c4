"""How long segments may be: as long as no drift shows in them beside the sensor's noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from oed.estimation.methods.fit import Fit
from oed.estimation.prediction.layout import SegmentLayout
from oed.estimation.setup.noise import LEAST, groups, places_of

SHORTEST = 1.0
"""Length of the shortest segments tried [s]."""
FEWEST = 8
"""Steps that the shortest segments have at least."""
GROWTH = 2.0
"""Factor by which the residuals' variance may grow with the length of segments before it counts as drift."""


@dataclass(frozen=True)
class Segmenting:
    """The length that was chosen, and why.

    Attributes:
        seconds: infinite for whole logs.
        fit: of that length.
        tried: root mean square residuals by length and noise, SI.
        drifts: whether longer segments showed drift.
    """

    seconds: float
    fit: Fit
    tried: dict[float, dict[str, float]]
    drifts: bool


def longest_without_drift(
    layout: Callable[[float], SegmentLayout], fit: Callable[[SegmentLayout], Fit]
) -> Segmenting:
    """The longest segments whose residuals are hardly larger than those of the shortest.

    Args:
        layout: the segments of a length [s].
        fit: the solution over segments.
    """
    chosen: tuple[float, Fit] | None = None
    tried: dict[float, dict[str, float]] = {}
    for seconds in _lengths(layout(math.inf)):
        found = fit(layout(seconds))
        tried[seconds] = spread(found)
        first = next(iter(tried.values()))
        if chosen is not None and any(
            tried[seconds][name] ** 2 > GROWTH * first[name] ** 2 for name in first
        ):
            return Segmenting(*chosen, tried, drifts=True)
        chosen = seconds, found
    assert chosen is not None
    return Segmenting(*chosen, tried, drifts=False)


def spread(fit: Fit) -> dict[str, float]:
    """Root mean square of the residuals of each noise, SI, as an unbiased estimate."""
    quantities, valid = fit.layout.quantities, fit.layout.valid
    found = {}
    for group in groups(quantities):
        own = places_of(group, quantities)
        squares = (fit.residuals[valid][:, own] ** 2).sum()
        size = float(np.sqrt(squares / max(fit.redundancy[valid][:, own].sum(), 1e-12)))
        # Rounding of exact readings is no drift.
        found[group] = max(size, LEAST)
    return found


def _lengths(whole: SegmentLayout) -> Iterator[float]:
    steps = whole.steps[whole.steps > 0]
    seconds = max(SHORTEST, FEWEST * float(np.median(steps)))
    longest = float((whole.times[:, -1] - whole.times[:, 0]).max())
    while seconds < longest / 1.5:
        yield seconds
        seconds *= 2
    yield math.inf
