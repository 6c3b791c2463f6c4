"""Drives of a simulated robot with slip, as a record has them."""

from __future__ import annotations

import itertools
from typing import Annotated

from pydantic import Field

from oed.records.stored.parts import (
    Count,
    Line,
    Number,
    Numbers,
    Positive,
    Rounded,
    Seed,
    Stored,
    require_different,
    require_known,
    require_table,
)


class Scaled(Stored):
    """A parameter of a model, and the size that its errors are relative to."""

    name: str
    nominal: Number
    unit: str
    scale: Annotated[float, Field(gt=0, le=1e100)]


class TriedModel(Stored):
    """A model on trial."""

    name: str
    kind: str
    parameters: list[Scaled]


class Fit(Stored):
    """How a model is calibrated."""

    name: str
    kind: str
    method: str


class StoredPlan(Stored):
    """A drive to calibrate from."""

    name: str
    model: str | None
    criterion: str | None
    status: str
    message: str
    feasible: bool
    violations: dict[str, Number]
    path_length: Number | None
    fastest: Number | None
    wall_seconds: Annotated[Positive, Rounded(3)]
    predicted: dict[str, Positive | None] | None = Field(alias="promised")
    path: Annotated[Line, Rounded(4)] | None
    inputs: list[Annotated[Numbers, Rounded(6)]] | None


class Around(Stored):
    """A number, and the interval it lies in."""

    value: Number | None
    low: Number | None
    high: Number | None


class Error(Around):
    """How far off a model's prediction is, calibrated from a drive [m]."""

    drive: str
    fit: str
    along: Number | None
    misfit: Number | None
    refused: Count
    each: Annotated[list[Number | None], Rounded(7)]


class Scatter(Stored):
    """How estimates from a drive scatter."""

    drive: str
    fit: str
    mean: Numbers
    relative: Numbers
    total: Around
    each: list[Numbers]


class StoredFloor(Stored):
    """What was found on one floor."""

    friction: Positive
    done: Count
    errors: list[Error]
    scatter: list[Scatter]
    drawn: Annotated[Numbers, Rounded(6)] = Field(default_factory=list)
    paths: dict[str, Annotated[Line, Rounded(4)]] = Field(default_factory=dict)


class SimulatedRobot(Stored):
    """The robot that drives."""

    kind: str


class Spread(Stored):
    """How much robots differ."""

    friction: Positive
    grip: Positive


class StoredTrial(Stored):
    """A record's `physics`."""

    robot: SimulatedRobot
    frictions: Annotated[Numbers, Field(min_length=1)]
    repeats: Count
    variation: Spread
    held_out: Count
    seed: Seed
    interrupted: bool
    models: Annotated[list[TriedModel], Field(min_length=1)]
    fits: Annotated[list[Fit], Field(min_length=1)]
    planned: list[StoredPlan]
    floors: list[StoredFloor]

    def _require(self) -> None:
        require_different("models", [one.name for one in self.models])
        require_different("planned", [one.name for one in self.planned])
        require_different("fits", [one.name for one in self.fits])
        models = [one.name for one in self.models]
        require_known("planned", (one.model for one in self.planned if one.model is not None), models)
        for place, floor in enumerate(self.floors):
            self._require_floor(f"floors.{place}", floor)
        driven = [set(floor.paths) for floor in self.floors if floor.errors]
        if any(names != driven[0] for names in driven):
            raise ValueError("floors: expected the same drives on every floor")

    def _require_floor(self, what: str, floor: StoredFloor) -> None:
        planned = [one.name for one in self.planned if one.path is not None]
        fits = [one.name for one in self.fits]
        drives = list(dict.fromkeys(one.drive for one in floor.errors))
        for names in (drives, floor.paths, (one.drive for one in floor.scatter)):
            require_known(what, names, planned)
        for names in ((one.fit for one in floor.errors), (one.fit for one in floor.scatter)):
            require_known(what, names, fits)
        there = {(one.drive, one.fit) for one in floor.errors}
        for drive, fit in itertools.product(drives, fits):
            if (drive, fit) not in there:
                raise ValueError(f"{what}.errors: expected one of {drive!r} and {fit!r}, got none")
        own = self.models[0]
        for one in floor.scatter:
            if one.fit == own.name:
                require_table(f"{what}.scatter", [one.relative], None, len(own.parameters))
