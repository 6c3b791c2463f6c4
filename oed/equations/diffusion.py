"""Process noise of systems given by equations: their states are random walks around the equations."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from oed.equations.dimensions import TIME, Dimension, Quantity, expect_quantity, quantity
from oed.equations.issues import Issues, no_such
from oed.equations.output_system import OutputSystem
from oed.foundation.text import listing, words
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.process_noise import Period, ProcessNoise

Rates = Sequence[tuple[str, Quantity]]
"""Deviations after 1 s with their units, by the states' names."""
_ROOT = re.compile(r"sqrt\(\s*(\w+)\s*\)")


@dataclass(frozen=True)
class Diffusion(ProcessNoise):
    """Random walks dx = f dt + sigma dW of states: independent errors N(0, sigma^2 T) in every period T.

    Half of a period's error is added at its begin, half at its end: the covariance of the continuous walk to
    second order in the period [Jazwinski: Stochastic processes and filtering theory, 1970, chapter 4].

    Attributes:
        sizes: name of each state, its sigma, SI, and the text that gave it.
    """

    key: ClassVar[str] = "diffusion"
    walks: ClassVar[str] = "Its states are random walks"
    sizes: tuple[tuple[str, float, str], ...]

    @property
    def size(self) -> int:
        """Number of states with process noise."""
        return len(self.sizes)

    def covariance(self, period: Period) -> Expression:
        """Return sigma^2 T of each of these states, as a diagonal matrix."""
        return period.duration * ca.DM(np.diag([size**2 for _, size, _ in self.sizes]))

    def step(self, period: Period, errors: Expression) -> Expression:
        """Step the system between two halves of the errors."""
        system, state, *rest = period
        table = np.zeros((len(system.states), self.size))
        for place, (name, *_) in enumerate(self.sizes):
            table[system.states.index(name), place] = 0.5
        half = ca.sparsify(ca.DM(table)) @ errors
        return system.step(state + half, *rest) + half

    @property
    def text(self) -> str:
        """Sizes as the study has them."""
        sizes = [f"{text} in {words(name)}" for name, _, text in self.sizes]
        return f"{listing(sizes)}, growing with the root of time"


def diffusion_of(rates: Rates) -> Diffusion | None:
    """Return the diffusion with the rates that can be read and are not 0; None without any."""
    sizes, issues = list[tuple[str, float, str]](), Issues()
    for name, value in rates:
        # Mistakes are reported by `diffusion_issues`.
        with issues.at():
            size, dimension = quantity(_plain(value))
            text = value if isinstance(value, str) else f"{size:g} {dimension.text}".strip()
            if size > 0:
                sizes.append((name, size, text))
    return Diffusion(tuple(sizes)) if sizes else None


def diffusion_issues(rates: Rates, system: OutputSystem) -> Issues:
    """Refuse rates of what is no state, in another unit or below 0."""
    issues = Issues("measurement", "diffusion")
    for name, value in rates:
        with issues.at(name):
            if name not in system.states:
                raise ValueError(no_such("state", system.states, name))
            dimension: Dimension = system.dimensions[name]
            message = (
                f"{name} is {dimension.words}, so this is in {dimension.text or '1'}/s^(1/2): the deviation "
                "after 1 s, which grows with the root of time; got one {got}"
            )
            if expect_quantity(_plain(value), dimension / TIME**0.5, message) < 0:
                raise ValueError(f"expected a deviation of 0 or more, got {value}")
    return issues


def _plain(value: Quantity) -> Quantity:
    # Units without roots: "0.1 K/sqrt(s)" is "0.1 K/s^(1/2)".
    return _ROOT.sub(r"\1^(1/2)", value) if isinstance(value, str) else value
