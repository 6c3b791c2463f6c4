"""What the trial is to show, and whether it does."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from oed.simulation.trial.statistics import Interval, Repeats, resampled_pair, scatter, total

Array = npt.NDArray[np.float64]

SCATTER_GOAL = 0.5
"""Scatter of the estimates from the optimal drive over that from a square, at most."""
SQUARE_GOAL, CIRCLE_GOAL = 0.5, 0.1
"""Held-out error of an optimal drive over that of a square and of a circle, at most."""
BEST_GOAL = 1.0
"""The same of the best optimal drive and model over the best everyday path and model."""


@dataclass(frozen=True)
class Floor:
    """What was found on one floor.

    Attributes:
        friction: of the floor.
        drives: names, the models' optimal drives first.
        optimal: the optimal drive of each model, by its name.
        fits: names of models, or of a model by a further method.
        repeats: held-out errors, (repeats, drives, fits) [m].
        values: estimates by (drive, fit), (repeats, p), SI; where none was refused.
        scales: of the parameters, by fit.
    """

    friction: float
    drives: tuple[str, ...]
    optimal: Mapping[str, str]
    fits: tuple[str, ...]
    repeats: Repeats
    values: Mapping[tuple[str, str], Array]
    scales: Mapping[str, Array]

    @property
    def everyday(self) -> tuple[str, ...]:
        """Names of the everyday paths."""
        return tuple(name for name in self.drives if name not in self.optimal.values())

    def cell(self, drive: str, fit: str) -> tuple[int, int]:
        """Where a drive and a fit stand."""
        return self.drives.index(drive), self.fits.index(fit)

    def cells(self, drives: Sequence[str]) -> list[tuple[int, int]]:
        """Of some drives with any fit."""
        return [self.cell(drive, fit) for drive in drives for fit in self.fits]


def goals(floor: Floor) -> list[dict[str, Any]]:
    """Every goal with the ratio found on a floor; none where there is nothing to compare."""
    if not floor.optimal or not floor.everyday:
        return []
    return [*_scatter_goals(floor), *_error_goals(floor), *_best_goal(floor)]


def _scatter_goals(floor: Floor) -> Iterator[dict[str, Any]]:
    # Of the study's own robot: the first model.
    model, drive = next(iter(floor.optimal.items()))
    for other in _squares(floor):
        pair = floor.values.get((drive, model)), floor.values.get((other, model))
        if pair[0] is None or pair[1] is None:
            continue

        def judged(values: Array) -> Array:
            return total(scatter(values, floor.scales[model]))

        found = resampled_pair(pair[0], pair[1], floor.repeats.picks, judged)
        yield _goal("scatter", floor, (drive, model), (other, model), found, SCATTER_GOAL)


def _error_goals(floor: Floor) -> Iterator[dict[str, Any]]:
    aims = [(name, SQUARE_GOAL) for name in _squares(floor)]
    aims += [(name, CIRCLE_GOAL) for name in floor.everyday if name == "circle"]
    for model, drive in floor.optimal.items():
        for other, most in aims:
            if not np.isfinite(floor.repeats.medians[floor.cell(other, model)]):
                # What most robots' calibrations refused is no error to compare with.
                continue
            found = floor.repeats.ratio([floor.cell(drive, model)], [floor.cell(other, model)])
            yield _goal("error", floor, (drive, model), (other, model), found, most)


def _best_goal(floor: Floor) -> Iterator[dict[str, Any]]:
    designed, everyday = floor.cells(list(floor.optimal.values())), floor.cells(floor.everyday)
    best = [floor.repeats.best(cells) for cells in (designed, everyday)]
    if not np.isfinite(floor.repeats.medians[best[1]]):
        return
    one, other = ((floor.drives[drive], floor.fits[fit]) for drive, fit in best)
    yield _goal("best", floor, one, other, floor.repeats.ratio(designed, everyday), BEST_GOAL)


def _squares(floor: Floor) -> list[str]:
    return [name for name in floor.everyday if name.endswith("square")]


def _goal(
    kind: str,
    floor: Floor,
    one: tuple[str, str],
    other: tuple[str, str],
    found: Interval,
    most: float,
) -> dict[str, Any]:
    return {
        "kind": kind,
        "friction": floor.friction,
        "drive": one[0],
        "model": one[1],
        "other_drive": other[0],
        "other_model": other[1],
        "ratio": plain(found.value),
        "interval": [plain(found.low), plain(found.high)],
        "most": most,
        "met": bool(found.value <= most),
        "sure": bool(found.high <= most) if found.value <= most else bool(found.low > most),
    }


def plain(value: float) -> float | None:
    """A number as JSON has it: None where it is infinite or none."""
    return float(value) if np.isfinite(value) else None
