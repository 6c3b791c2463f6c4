"""What may be chosen of an experiment with a system given by equations, as a study says it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from oed.equations.candidates import Candidates
from oed.equations.dimensions import Dimension, parse_unit, quantity
from oed.equations.given import Begin, Quantity
from oed.equations.limits import InputRange, InputRate, OneInput, both_ways, require_rising
from oed.foundation.component import Component, OneOf
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.quantities import Duration
from oed.kernel.dynamics.held import HeldSpace
from oed.kernel.dynamics.signals import SIGNALS, PiecewiseConstant, Signal
from oed.kernel.dynamics.space import SignalSpace, Space, Spline
from oed.kernel.dynamics.system import System

Seconds = Annotated[Duration, Field(gt=0)]


class InputKeys(Component):
    """What an input may do.

    Attributes:
        range: least and largest value, with their units; alone it stands for all of this.
        rate: largest rate of change, or least and largest.
        signal: what it may be over a trial; steps by default.
    """

    range: tuple[Quantity, Quantity]
    rate: Quantity | tuple[Quantity, Quantity] | None = None
    signal: Annotated[Signal, OneOf(SIGNALS)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _bare_range(cls, value: Any) -> Any:
        return value if isinstance(value, dict) else {"range": value}

    @field_validator("range")
    @classmethod
    def _rises(cls, given: tuple[Quantity, Quantity]) -> tuple[Quantity, Quantity]:
        low, high = (quantity(one)[0] for one in given)
        require_rising(given, (low, high))
        return given

    @field_validator("rate")
    @classmethod
    def _a_rate(cls, given: Any) -> Any:
        if given is not None:
            both_ways(given)
        return given

    def limits(self, name: str) -> list[OneInput]:
        """Of the input of that name."""
        found: list[OneInput] = [InputRange(input=name, range=self.range)]
        return found if self.rate is None else [*found, InputRate(input=name, rate=self.rate)]


class Experiment(Component):
    """An experiment: for how long, and what its inputs may do.

    Attributes:
        points: settings of the inputs, each for itself, of a system without states.
        candidates: instead of what inputs may do, the trials to choose among; of a system without states the
            settings of the inputs.
        duration: of one trial, of a system with states; or the shortest and the longest, to choose between.
        samples: periods of a trial, in each of which the inputs are held.
        trials: designed together, each with inputs and initial values of its own.
        inputs: what each may do.
    """

    points: Annotated[int, Field(ge=1, le=100_000)] | None = None
    candidates: Candidates | None = None
    duration: Annotated[Duration, Field(gt=0)] | tuple[Seconds, Seconds] | None = None
    samples: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    trials: Annotated[int, Field(ge=1, le=100)] | None = None
    inputs: dict[str, InputKeys] = Field(default_factory=dict)

    @property
    def longest(self) -> float | None:
        """Duration of a trial [s], the longest where it is chosen."""
        return self.duration[1] if isinstance(self.duration, tuple) else self.duration

    def issues(self, system: System) -> list[Issue]:
        """What is missing, or means nothing, for a system; [] if nothing."""
        given = "candidates" if self.candidates is not None else "inputs"
        issues = self._input_issues(system.input_names) if given == "inputs" else []
        if system.states:
            wrong, needed, text = ["points"], "duration", "say how long a trial takes, e.g. 10 s"
        else:
            text = "say how many settings of the inputs there are, e.g. 4"
            wrong, needed = ["duration", "samples", "trials"], "points"
        means = f"means nothing for a system {'with' if system.states else 'without'} states"
        issues += [Issue(("experiment", key), means) for key in wrong if getattr(self, key) is not None]
        beside = ["points", "trials", *(["inputs"] if self.inputs else [])] if given == "candidates" else []
        issues += [
            Issue(("experiment", key), "means nothing beside candidates: leave it out")
            for key in beside
            if getattr(self, key) is not None and key not in wrong
        ]
        if isinstance(self.duration, tuple):
            issues += self._duration_issues(self.duration)
        missing = getattr(self, needed) is None and (given == "inputs" or needed == "duration")
        return issues + ([Issue(("experiment", needed), f"missing: {text}")] if missing else [])

    def _duration_issues(self, duration: tuple[float, float]) -> list[Issue]:
        issues = [
            Issue(
                ("experiment", "inputs", name, "rate"),
                "is not known where the duration is chosen: leave one out",
            )
            for name, one in self.inputs.items()
            if one.rate is not None
        ]
        if not duration[0] < duration[1]:
            issues.append(
                Issue(("experiment", "duration"), f"expected [shortest, longest], got {list(duration)}")
            )
        if self.candidates is not None or not self.inputs:
            text = "can be chosen with inputs only: give one, or a fixed duration"
            issues.append(Issue(("experiment", "duration"), text))
        return issues

    def _input_issues(self, inputs: Sequence[str]) -> list[Issue]:
        issues = [
            Issue(("experiment", "inputs", name), f"the system has no such input; it has {_listed(inputs)}")
            for name in self.inputs
            if name not in inputs
        ]
        return issues + [
            Issue(("experiment", "inputs"), f"missing: what {name} may do, e.g. {name}: [0, 1]")
            for name in inputs
            if name not in self.inputs
        ]

    def space(self, system: System, begins: Mapping[str, Begin]) -> Space:
        """All that may be chosen, of a system whose states begin so.

        Raises:
            ProblemError: candidates that are none, inputs that are missing.
        """
        if issues := self.issues(system):
            raise ProblemError(issues)
        start, trials = [one.low for one in begins.values()], self.trials or 1
        samples = self.points or self.samples or USUAL_SAMPLES
        chosen = [name for name, one in begins.items() if one.low < one.high]
        if self.candidates is not None:
            if chosen:
                text = "is not chosen among candidates: give the value that it begins at"
                raise ProblemError([Issue(("system", "states", name, "design"), text) for name in chosen])
            settings = self.candidates.table(input_dimensions(system))
            if not system.states:
                return HeldSpace.of(settings, np.zeros((1, 0)), duration=float(len(settings)))
            held, trials = np.repeat(settings, samples, axis=0), len(settings)
            return HeldSpace.of(held, np.tile(start, (trials, 1)), duration=self.longest or 1.0)
        ranges = tuple((one.low, one.high) for one in begins.values())
        if not system.input_names and chosen:
            alone = Spline(degree=0, coefficients=samples)
            return SignalSpace(
                duration=self.longest or 1.0,
                samples=samples,
                spline=alone,
                rest_to_rest=False,
                runs=trials,
                start_bounds=ranges,
            )
        if not system.input_names:
            held = np.zeros((trials * samples, 0))
            return HeldSpace.of(held, np.tile(start, (trials, 1)), duration=self.longest or 1.0)
        usual = PiecewiseConstant(pieces=samples if self.points else min(samples, USUAL_PIECES))
        given: dict[str, Any] = {"start": tuple(start)}
        if chosen:
            given = {"start_bounds": ranges}
        return SignalSpace(
            duration=self.longest or float(samples),
            samples=samples,
            runs=trials,
            signals=tuple(self.inputs[name].signal or usual for name in system.input_names),
            shortest=self.duration[0] if isinstance(self.duration, tuple) else None,
            **given,
        )

    @property
    def times(self) -> Space:
        """How long trials take, whatever they are of."""
        samples = self.points or self.samples or USUAL_SAMPLES
        return SignalSpace(
            duration=self.longest or float(samples), samples=samples, runs=self.trials or 1, start="free"
        )

    @property
    def limits(self) -> tuple[OneInput, ...]:
        """Of all inputs."""
        return tuple(limit for name, one in self.inputs.items() for limit in one.limits(name))


def input_dimensions(system: System) -> dict[str, Dimension]:
    """Dimensions of a system's inputs, by name."""
    return {one.name: parse_unit(one.unit)[1] for one in system.inputs}


USUAL_SAMPLES, USUAL_PIECES = 100, 20
"""Periods of a trial, and steps of an input in it, where nothing is said."""


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
