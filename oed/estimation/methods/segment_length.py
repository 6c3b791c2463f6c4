"""How long the segments of logs are: as long as no drift shows in them beside the sensor's noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from oed.estimation.methods.correlated_readings import CorrelatedReadings
from oed.estimation.methods.fit import Fit
from oed.estimation.methods.joint import JointSearch
from oed.estimation.methods.noise_selection import bounded_errors
from oed.estimation.prediction.layout import SegmentLayout, shortest_seconds
from oed.estimation.setup.noise import LEAST, groups, places_of

GROWTH = 2.0
"""Factor by which the residuals' variance may grow with the length of segments before it counts as drift."""
BOUNDED = (
    "residuals grow with the length of segments, but whole logs are likelier to have such errors than drift: "
    "they are fitted whole"
)
"""Note on logs whose errors are large for a while, but bounded."""


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

    @property
    def turns_drift(self) -> bool:
        """Whether measured headings leave the wheels' in longer segments: readings' errors do not grow."""
        sizes = [one.get("heading", 0.0) for one in self.tried.values()]
        return sizes[-1] ** 2 > GROWTH * sizes[0] ** 2


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
    for seconds in lengths_tried(layout(math.inf)):
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
        present = valid[..., own]
        squares = (fit.residuals[..., own][present] ** 2).sum()
        size = float(np.sqrt(squares / max(fit.redundancy[..., own][present].sum(), 1e-12)))
        # Rounding of exact readings is no drift.
        found[group] = max(size, LEAST)
    return found


def lengths_tried(whole: SegmentLayout) -> Iterator[float]:
    """From the shortest segments [s] in doublings to whole logs, infinite."""
    seconds = shortest_seconds(whole)
    longest = float((whole.times[:, -1] - whole.times[:, 0]).max())
    while seconds < longest / 1.5:
        yield seconds
        seconds *= 2
    yield math.inf


def if_bounded(short: Segmenting, whole: JointSearch) -> Segmenting:
    """Whole logs, where their errors last but do not grow; else the segments that were chosen.

    Args:
        short: the longest segments whose residuals hardly grow.
        whole: the search over whole logs.
    """
    fit = short.fit
    noise = bounded_errors(whole, fit.values, fit.noises)
    if noise is None:
        return short
    found = CorrelatedReadings(whole).fit(fit.values, noise)
    found = replace(found, notes=(*found.notes, *([BOUNDED] if short.drifts else [])))
    return replace(short, seconds=math.inf, fit=found, drifts=False)
