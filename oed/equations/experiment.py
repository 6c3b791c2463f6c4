"""Choices of an experiment with a system given by equations, as a study has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from oed.equations.candidates import Candidates
from oed.equations.initial_values import InitialValue
from oed.equations.issues import Issues, no_such
from oed.equations.limits import InputRange, InputRate, OneInput, Range, Rate, input_dimensions
from oed.foundation.component import Component, OneOf
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.quantities import Duration
from oed.kernel.dynamics.held import HeldSpace
from oed.kernel.dynamics.signals import SIGNALS, PiecewiseConstant, Signal
from oed.kernel.dynamics.space import SignalSpace, Space, Spline
from oed.kernel.dynamics.system import System

Seconds = Annotated[Duration, Field(gt=0)]
USUAL_SAMPLES, USUAL_PIECES = 100, 20
"""Periods of a trial, and steps of an input in it, by default."""


class InputKeys(Component):
    """Choices of one input.

    Attributes:
        range: least and largest value, with their units; alone it stands for all of this.
        rate: largest rate of change, or least and largest.
        signal: shape of the input over a trial; steps by default.
    """

    range: Range
    rate: Rate | None = None
    signal: Annotated[Signal, OneOf(SIGNALS)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _bare_range(cls, value: Any) -> Any:
        return value if isinstance(value, dict) else {"range": value}


class Experiment(Component):
    """Durations, trials and inputs of an experiment.

    Attributes:
        points: number of settings of the inputs, each for itself, of a system without states.
        candidates: instead of choices of the inputs, the trials to choose among; without states the settings
            of the inputs.
        duration: duration of one trial, of a system with states; or the shortest and the longest, to choose
            between.
        samples: periods of a trial, in each of which the inputs are held.
        trials: number of trials designed together, each with inputs and initial values of its own.
        inputs: choices of the inputs, by name.
    """

    points: Annotated[int, Field(ge=1, le=100_000)] | None = None
    candidates: Candidates | None = None
    duration: Seconds | tuple[Seconds, Seconds] | None = None
    samples: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    trials: Annotated[int, Field(ge=1, le=100)] | None = None
    inputs: dict[str, InputKeys] = Field(default_factory=dict)

    def issues(self, system: System) -> list[Issue]:
        """Return the keys that are missing or mean nothing for a system; [] if there are none."""
        issues = Issues("experiment")
        needed, remedy = "points", "say how many settings of the inputs there are, e.g. 4"
        idle, kind = ["duration", "samples", "trials"], "without"
        if system.states:
            needed, remedy = "duration", "say how long a trial takes, e.g. 10 s"
            idle, kind = ["points"], "with"
        reasons = dict.fromkeys(idle, f"means nothing for a system {kind} states")
        if self.candidates is None:
            names, missing = system.input_names, "missing: what {} may do, e.g. {}: [0, 1]"
            issues.compare(self.inputs, names, missing, no_such("input", names), "inputs")
        else:
            superfluous = "means nothing beside candidates: leave it out"
            reasons = dict.fromkeys(("points", "trials", "inputs"), superfluous) | reasons
        for key, reason in reasons.items():
            if getattr(self, key):
                issues.add(reason, key)
        self._check_duration(issues)
        if getattr(self, needed) is None and (self.candidates is None or system.states):
            issues.add(f"missing: {remedy}", needed)
        return issues

    def _check_duration(self, issues: Issues) -> None:
        if not isinstance(self.duration, tuple):
            return
        for name, keys in self.inputs.items():
            if keys.rate is not None:
                unknown = "is not known where the duration is chosen: leave one out"
                issues.add(unknown, "inputs", name, "rate")
        if not self.duration[0] < self.duration[1]:
            issues.add(f"expected [shortest, longest], got {list(self.duration)}", "duration")
        if self.candidates is not None or not self.inputs:
            issues.add("can be chosen with inputs only: give one, or a fixed duration", "duration")

    def space(self, system: System, initial_values: Mapping[str, InitialValue]) -> Space:
        """Return all that may be chosen.

        Args:
            system: the system.
            initial_values: initial values of its states.

        Raises:
            ProblemError: mistakes in candidates or inputs.
        """
        if issues := self.issues(system):
            raise ProblemError(issues)
        start, trials = [value.low for value in initial_values.values()], self.trials or 1
        chosen = [name for name, value in initial_values.items() if value.low < value.high]
        keys = self._keys
        samples = keys["samples"]
        if self.candidates is not None:
            issues = Issues("system", "states")
            for name in chosen:
                issues.add("is not chosen among candidates: give the value that it begins at", name, "design")
            issues.check()
            held = self.candidates.table(input_dimensions(system))
            if not system.states:
                return HeldSpace.of(held, np.zeros((1, 0)), duration=float(len(held)))
            starts = np.tile(start, (len(held), 1))
            return HeldSpace.of(np.repeat(held, samples, axis=0), starts, duration=keys["duration"])
        if not system.input_names and not chosen:
            held = np.zeros((trials * samples, 0))
            return HeldSpace.of(held, np.tile(start, (trials, 1)), duration=keys["duration"])
        if chosen:
            keys["start_bounds"] = tuple((value.low, value.high) for value in initial_values.values())
        else:
            keys["start"] = tuple(start)
        if not system.input_names:
            constant = Spline(degree=0, coefficients=samples)
            return SignalSpace(**keys, spline=constant, rest_to_rest=False)
        usual = PiecewiseConstant(pieces=samples if self.points else min(samples, USUAL_PIECES))
        signals = tuple(self.inputs[name].signal or usual for name in system.input_names)
        shortest = self.duration[0] if isinstance(self.duration, tuple) else None
        return SignalSpace(**keys, signals=signals, shortest=shortest)

    @property
    def times(self) -> Space:
        """Durations and samples of trials, whatever the system."""
        return SignalSpace(**self._keys, start="free")

    @property
    def _keys(self) -> dict[str, Any]:
        # What all spaces have in common.
        samples = self.points or self.samples or USUAL_SAMPLES
        longest = self.duration[1] if isinstance(self.duration, tuple) else self.duration
        return {"duration": longest or float(samples), "samples": samples, "runs": self.trials or 1}

    @property
    def limits(self) -> tuple[OneInput, ...]:
        """Limits on all inputs."""
        limits = list[OneInput]()
        for name, keys in self.inputs.items():
            limits.append(InputRange(input=name, range=keys.range))
            if keys.rate is not None:
                limits.append(InputRate(input=name, rate=keys.rate))
        return tuple(limits)
