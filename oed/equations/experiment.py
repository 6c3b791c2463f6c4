"""What may be chosen of an experiment with a system given by equations, as a study says it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field, field_validator, model_validator

from oed.equations.dimensions import quantity
from oed.equations.keys import Begin, Quantity
from oed.equations.limits import InputRange, InputRate, both_ways, require_rising
from oed.foundation.component import Component
from oed.foundation.errors import Flaw
from oed.foundation.quantities import Duration
from oed.kernel.dynamics.space import SignalSpace, Spline
from oed.kernel.limit import Limit


class InputKeys(Component):
    """What an input may do.

    Attributes:
        range: least and largest value, with their units; alone it stands for all of this.
        rate: largest rate of change, or least and largest.
    """

    range: tuple[Quantity, Quantity]
    rate: Quantity | tuple[Quantity, Quantity] | None = None

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

    def limits(self, name: str) -> list[Limit]:
        """Of the input of that name."""
        found: list[Limit] = [InputRange(input=name, range=self.range)]
        return found if self.rate is None else [*found, InputRate(input=name, rate=self.rate)]


class Experiment(Component):
    """An experiment: for how long, and what its inputs may do.

    Attributes:
        points: settings of the inputs, each for itself, of a system without states.
        duration: of one trial, of a system with states.
        samples: periods of a trial, in each of which the inputs are held.
        trials: designed together, each with inputs and initial values of its own.
        inputs: what each may do.
    """

    points: Annotated[int, Field(ge=1, le=100_000)] | None = None
    duration: Annotated[Duration, Field(gt=0)] | None = None
    samples: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    trials: Annotated[int, Field(ge=1, le=100)] = 1
    inputs: dict[str, InputKeys] = Field(default_factory=dict)

    def flaws(self, states: Sequence[str], inputs: Sequence[str]) -> list[Flaw]:
        """What is missing, or means nothing, for a system with these states and inputs; [] if nothing."""
        flaws = [
            Flaw(("experiment", "inputs", name), f"the system has no such input; it has {_listed(inputs)}")
            for name in self.inputs
            if name not in inputs
        ]
        flaws += [
            Flaw(("experiment", "inputs"), f"missing: what {name} may do, e.g. {name}: [0, 1]")
            for name in inputs
            if name not in self.inputs
        ]
        if states:
            wrong, needed, text = ["points"], "duration", "say how long a trial takes, e.g. 10 s"
        else:
            text = "say how many settings of the inputs there are, e.g. 4"
            wrong, needed = ["duration", "samples"], "points"
        means = f"means nothing for a system {'with' if states else 'without'} states"
        flaws += [Flaw(("experiment", key), means) for key in wrong if getattr(self, key) is not None]
        missing = getattr(self, needed) is None
        return flaws + ([Flaw(("experiment", needed), f"missing: {text}")] if missing else [])

    def space(self, begins: Mapping[str, Begin]) -> SignalSpace:
        """All that may be chosen, of a system whose states begin so."""
        samples = self.points or self.samples or USUAL_SAMPLES
        return SignalSpace(
            duration=self.duration or float(samples),
            samples=samples,
            spline=Spline(degree=0, coefficients=samples),
            rest_to_rest=False,
            runs=self.trials,
            start=tuple(one.low for one in begins.values()),
        )

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Of all inputs."""
        return tuple(limit for name, one in self.inputs.items() for limit in one.limits(name))


USUAL_SAMPLES = 100
"""Periods of a trial, where nothing is said."""


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"
