"""Process noise of systems that are given by equations: states wander beside what their equations say."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import ClassVar

import casadi as ca
import numpy as np

from oed.equations.dimensions import TIME, Dimension, quantity
from oed.equations.given import Readable
from oed.foundation.errors import Issue
from oed.foundation.text import did_you_mean, listing, words
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.process_noise import Period, ProcessNoise

Rates = Sequence[tuple[str, str | float]]
"""Deviations after 1 s with their units, by the states' names."""
_ROOT = re.compile(r"sqrt\(\s*(\w+)\s*\)")
ROOT_TIME = TIME ** Fraction(1, 2)
"""Of the root of a time."""


@dataclass(frozen=True)
class Diffusion(ProcessNoise):
    """States follow dx = f dt + sigma dW: each errs by N(0, sigma^2 T) in a period T, independently.

    Half of a period's error is there at its begin, half at its end: the covariance of the continuous walk to
    second order in the period [Jazwinski: Stochastic processes and filtering theory, 1970, chapter 4].

    Attributes:
        sizes: sigma, SI, and as it was written, by the state's name.
    """

    key: ClassVar[str] = "diffusion"
    walks: ClassVar[str] = "Its states are random walks"
    sizes: tuple[tuple[str, float, str], ...]

    @property
    def size(self) -> int:
        """One for each state that wanders."""
        return len(self.sizes)

    def covariance(self, period: Period) -> Expression:
        """sigma^2 T of each."""
        return period.duration * ca.DM(np.diag([size**2 for _, size, _ in self.sizes]))

    def step(self, period: Period, errors: Expression) -> Expression:
        """As the system steps, from a state with half of the errors; and the other half."""
        system, state, *rest = period
        table = np.zeros((len(system.states), self.size))
        for place, (name, *_) in enumerate(self.sizes):
            table[system.states.index(name), place] = 0.5
        half = ca.sparsify(ca.DM(table)) @ errors
        return system.step(state + half, *rest) + half

    @property
    def text(self) -> str:
        """As it was given."""
        each = [f"{written} in {words(name)}" for name, _, written in self.sizes]
        return f"{listing(each)}, growing with the root of time"


def diffusion_of(rates: Rates) -> Diffusion | None:
    """The diffusion with these rates, those that can be read and are not 0; None of none."""
    found = []
    for name, value in rates:
        try:
            size, dimension = _rate(value)
        except ValueError:
            # Said by `diffusion_issues`.
            continue
        if size > 0:
            written = value if isinstance(value, str) else f"{size:g} {dimension.text}".strip()
            found.append((name, size, written))
    return Diffusion(tuple(found)) if found else None


def diffusion_issues(rates: Rates, system: Readable) -> Iterator[Issue]:
    """Rates of what is no state, or in another unit, or below 0."""
    for name, value in rates:
        if reason := _issue(name, value, system):
            yield Issue(("measurement", "diffusion", name), reason)


def _issue(name: str, value: str | float, system: Readable) -> str:
    if name not in system.states:
        known = listing(list(system.states)) if system.states else "none"
        return f"there is no such state; there is {known}{did_you_mean(name, system.states)}"
    expected = system.dimensions[name] / ROOT_TIME
    try:
        size, dimension = _rate(value)
    except ValueError as error:
        return str(error)
    if size < 0:
        return f"expected a deviation of 0 or more, got {value}"
    if dimension.fits(expected):
        return ""
    state = system.dimensions[name].text or "1"
    text = f"{name} is {system.dimensions[name].words}, so this is in {state}/s^(1/2)"
    return f"{text}: the deviation after 1 s, which grows with the root of time; got one {dimension.words}"


def _rate(value: str | float) -> tuple[float, Dimension]:
    # Of "0.1 K/sqrt(s)", or "0.1 K/s^(1/2)".
    return quantity(_ROOT.sub(r"\1^(1/2)", value) if isinstance(value, str) else value)
