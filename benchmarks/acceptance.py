"""Whether trials of drives on slipping robots meet this project's goals: `python -m benchmarks.acceptance`.

Reads saved records, as reports/gallery/physics_skid_steer, and computes every ratio from the repeats that
they hold.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from oed import load_record
from oed.simulation.trial.outcome import Interval, Repeats, interval, scatter, total

Array = npt.NDArray[np.float64]
Cell = tuple[str, str]
"""A drive, and the model (or fit) that is calibrated from it."""

SCATTER_GOAL = 0.5
"""Scatter of the estimates from the optimal drive over that from a square, at most."""
SQUARE_GOAL, CIRCLE_GOAL = 0.5, 0.1
"""Held-out error of an optimal drive over that of a square and of a circle, at most."""
BEST_GOAL = 1.0
"""The same of the best optimal drive and model over the best baseline and model."""


@dataclass(frozen=True)
class Goal:
    """A ratio that a goal is set for, as found on one floor.

    Attributes:
        kind: of estimates' scatter, of held-out errors, or of the best of these.
        friction: of the floor.
        one: what is judged.
        other: what it is compared with.
        found: the ratio of the two.
        most: that it may be.
    """

    kind: Literal["scatter", "error", "best"]
    friction: float
    one: Cell
    other: Cell
    found: Interval
    most: float

    @property
    def met(self) -> bool:
        """Whether the goal is reached."""
        return self.found.value <= self.most

    @property
    def sure(self) -> bool:
        """Whether all of the interval says the same."""
        return self.met == (self.found.low <= self.most) == (self.found.high <= self.most)

    def __str__(self) -> str:
        """In a line."""
        (drive, model), (other_drive, other_model) = self.one, self.other
        found = f"{self.found.value:.2g} ({self.found.low:.2g} to {self.found.high:.2g})"
        verdict = ("met" if self.met else "missed") + ("" if self.sure else ", not by all of the interval")
        return (
            f"friction {self.friction:g}, {self.kind}: {drive} with {model} against {other_drive} with "
            f"{other_model}: {found}, at most {self.most:g}: {verdict}"
        )


@dataclass(frozen=True)
class Floor:
    """What a record has of one floor.

    Attributes:
        friction: of the floor.
        drives: names.
        optimal: the optimal drive of each model, by its name.
        fits: names of models, or of a model by a further method.
        repeats: held-out errors, (repeats, drives, fits) [m].
        values: estimates by cell, (repeats, p), SI; where none was refused.
        scales: of the parameters, by model.
    """

    friction: float
    drives: tuple[str, ...]
    optimal: Mapping[str, str]
    fits: tuple[str, ...]
    repeats: Repeats
    values: Mapping[Cell, Array]
    scales: Mapping[str, Array]

    @property
    def baselines(self) -> tuple[str, ...]:
        """Names of the usual drives."""
        return tuple(name for name in self.drives if name not in self.optimal.values())

    @property
    def squares(self) -> tuple[str, ...]:
        """Those of them that are squares."""
        return tuple(name for name in self.baselines if name.endswith("square"))

    def cells(self, drives: Sequence[str]) -> list[Cell]:
        """Of some drives with any fit."""
        return [(drive, fit) for drive in drives for fit in self.fits]

    def median(self, cell: Cell) -> float:
        """Held-out error [m]; infinite where most calibrations were refused."""
        return float(self.repeats.medians[self._place(cell)])

    def ratio(self, one: Sequence[Cell], other: Sequence[Cell]) -> Interval:
        """The least median of some cells over the least of others, chosen anew in every resample."""
        with np.errstate(divide="ignore", invalid="ignore"):
            value, resampled = (
                self._least(medians, one) / self._least(medians, other)
                for medians in (self.repeats.medians, self.repeats.resampled)
            )
        return interval(float(value), resampled)

    def _least(self, medians: Array, cells: Sequence[Cell]) -> Array:
        drives, fits = zip(*map(self._place, cells), strict=True)
        return np.asarray(medians[..., drives, fits].min(axis=-1))

    def _place(self, cell: Cell) -> tuple[int, int]:
        return self.drives.index(cell[0]), self.fits.index(cell[1])


def floors_of(trial: Mapping[str, Any]) -> list[Floor]:
    """What a record's `physics` has of every floor that enough robots drove on."""
    return [_floor(trial, floor) for floor in trial["floors"] if floor["errors"]]


def _floor(trial: Mapping[str, Any], floor: Mapping[str, Any]) -> Floor:
    cells = {(entry["drive"], entry["fit"]): entry["each"] for entry in floor["errors"]}
    drives, fits = (tuple(dict.fromkeys(names)) for names in zip(*cells, strict=True))
    # What is not finite is saved as none.
    errors = np.array([[cells[drive, fit] for fit in fits] for drive in drives], dtype=float)
    errors[np.isnan(errors)] = np.inf
    return Floor(
        friction=floor["friction"],
        drives=drives,
        optimal={
            one["model"]: one["name"] for one in trial["planned"] if one["model"] and one["name"] in drives
        },
        fits=fits,
        repeats=Repeats(np.moveaxis(errors, -1, 0), trial["resamples"], trial["seed"]),
        values={(entry["drive"], entry["fit"]): np.array(entry["each"]) for entry in floor["scatter"]},
        scales={
            model["name"]: np.array([one["scale"] for one in model["parameters"]])
            for model in trial["models"]
        },
    )


def goals(floor: Floor) -> list[Goal]:
    """Every goal with the ratio found on a floor; none where there is nothing to compare."""
    if not floor.optimal or not floor.baselines:
        return []
    return [*_scatter_goals(floor), *_error_goals(floor), *_best_goal(floor)]


def _scatter_goals(floor: Floor) -> Iterator[Goal]:
    # Of the study's own robot: the first model.
    model, drive = next(iter(floor.optimal.items()))

    def judged(values: Array) -> Array:
        return total(scatter(values, floor.scales[model]))

    for other in floor.squares:
        one, another = floor.values.get((drive, model)), floor.values.get((other, model))
        if one is not None and another is not None:
            found = resampled_pair(one, another, floor.repeats.picks, judged)
            yield Goal("scatter", floor.friction, (drive, model), (other, model), found, SCATTER_GOAL)


def resampled_pair(
    one: Array, other: Array, picks: npt.NDArray[np.int64], judged: Callable[[Array], Array]
) -> Interval:
    """The ratio of a statistic of two sets of estimates (repeats, p) by the same repeats.

    Args:
        one: estimates.
        other: those to compare with.
        picks: repeats of every resample.
        judged: what is compared, of estimates (..., repeats, p).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return interval(float(judged(one) / judged(other)), judged(one[picks]) / judged(other[picks]))


def _error_goals(floor: Floor) -> Iterator[Goal]:
    aims = [(name, SQUARE_GOAL) for name in floor.squares]
    aims += [(name, CIRCLE_GOAL) for name in floor.baselines if name == "circle"]
    for model, drive in floor.optimal.items():
        for other, most in aims:
            one, another = (drive, model), (other, model)
            # What most robots' calibrations refused is no error to compare with.
            if np.isfinite(floor.median(another)):
                yield Goal("error", floor.friction, one, another, floor.ratio([one], [another]), most)


def _best_goal(floor: Floor) -> Iterator[Goal]:
    designed, baselines = floor.cells(list(floor.optimal.values())), floor.cells(floor.baselines)
    one, other = (min(cells, key=floor.median) for cells in (designed, baselines))
    if np.isfinite(floor.median(other)):
        yield Goal("best", floor.friction, one, other, floor.ratio(designed, baselines), BEST_GOAL)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print every goal; 1 if one of them is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.acceptance", description=__doc__)
    parser.add_argument("records", nargs="+", metavar="DIR", type=Path, help="where a run saved its record")
    found: list[Goal] = []
    for folder in parser.parse_args(arguments).records:
        trial = load_record(folder).data.get("physics")
        if not trial:
            parser.error(f"{folder}: no trial; its study has no key physics")
        found += [goal for floor in floors_of(trial) for goal in goals(floor)]
    print(*found, sep="\n")
    return 0 if all(goal.met for goal in found) else 1


if __name__ == "__main__":
    sys.exit(main())
