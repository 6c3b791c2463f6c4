"""Absolute poses, as a laser tracker or motion capture gives them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import casadi as ca
import numpy as np
from pydantic import Field, field_validator, model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Flaw
from oed.foundation.quantities import Angle, Duration, Length, LengthPerYawRate, Unit, require_covariance
from oed.foundation.text import count, given_text, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.description import deviations_text
from oed.kernel.measurement.sensor import Moment
from oed.robots.sensors.logged import Mount, Noise
from oed.robots.sensors.placed import PlacedSensor

Matrix = tuple[tuple[float, ...], ...]
Quantity = Literal["x", "y", "heading"]
UNITS = {"x": "m", "y": "m", "position": "m", "heading": "rad"}
"""SI units of what poses have."""
USUAL = {"m": "1 cm", "rad": "1 deg"}
"""Usual noise by its SI unit, for examples."""
AnglePerSpeed = Annotated[float, Unit("rad*s/m", "2 deg*s/m")]


class AbsoluteNoise(Component):
    """Errors of one absolute pose, as standard deviations or as a covariance matrix.

    Attributes:
        position: of x and of y [m]; x and y may be given apart.
        x, y: [m].
        heading: [rad].
        position_per_speed: k_v in the variance sigma^2 + (k_v V)^2 + (k_w Omega)^2 of a position, V the speed
            [s].
        heading_per_speed: the same of a heading [rad s/m].
        position_per_yaw_rate: k_w there, Omega the yaw rate [m s/rad].
        heading_per_yaw_rate: the same of a heading [s], e.g. readings whose times jitter by so much.
        covariance: of one pose's quantities, in their order, (q, q); or of all readings, pose by pose,
            (K q, K q); in SI units. Instead of the others.
    """

    position: Annotated[Length, Field(gt=0)] | None = None
    x: Annotated[Length, Field(gt=0)] | None = None
    y: Annotated[Length, Field(gt=0)] | None = None
    heading: Annotated[Angle, Field(gt=0)] | None = None
    position_per_speed: Annotated[Duration, Field(ge=0)] = 0.0
    heading_per_speed: Annotated[AnglePerSpeed, Field(ge=0)] = 0.0
    position_per_yaw_rate: Annotated[LengthPerYawRate, Field(ge=0)] = 0.0
    heading_per_yaw_rate: Annotated[Duration, Field(ge=0)] = 0.0
    covariance: Matrix | None = None

    @field_validator("covariance")
    @classmethod
    def _is_a_covariance(cls, rows: Matrix | None) -> Matrix | None:
        if rows is not None:
            require_covariance(rows)
        return rows

    @model_validator(mode="after")
    def _one_way_to_give_it(self) -> AbsoluteNoise:
        others = [name for name, value in self if name != "covariance" and value]
        if self.covariance is not None and others:
            raise ValueError(f"a covariance says it all: omit {', '.join(others)}")
        return self

    def deviation(self, quantity: Quantity) -> float | None:
        """Standard deviation at rest, SI; None where it is not given."""
        own: float | None = getattr(self, quantity)
        return self.position if own is None and quantity != "heading" else own

    def of(self, quantity: Quantity) -> Noise | None:
        """The noise of one quantity; None where it is not given."""
        return None if self.deviation(quantity) is None else self.at_least(quantity)

    def drawn(
        self, quantities: Sequence[Quantity], speeds: Array, yaw_rates: Array, rng: np.random.Generator
    ) -> Array:
        """Errors (n, q) of poses at `speeds` [m/s] and `yaw_rates` [rad/s], both (n,); none where a
        quantity has no noise.

        Args:
            quantities: of "x", "y", "heading", q of them.
            speeds: of the robot's origin [m/s], (n,).
            yaw_rates: [rad/s], (n,).
            rng: of the draws.
        """
        standard = rng.normal(size=(len(speeds), len(quantities)))
        if self.covariance is not None:
            return np.asarray(standard @ np.linalg.cholesky(np.array(self.covariance)).T)
        own = [self.at_least(name).deviation(speeds, yaw_rates) for name in quantities]
        return np.asarray(standard * np.column_stack(own))

    def at_least(self, quantity: Quantity) -> Noise:
        """Standard deviations of all quantities at rest, SI; 0 where one is not given."""
        size = self.deviation(quantity) or 0.0
        if quantity == "heading":
            return Noise(size, self.heading_per_speed, self.heading_per_yaw_rate)
        return Noise(size, self.position_per_speed, self.position_per_yaw_rate)

    def text(self, quantities: tuple[Quantity, ...]) -> str:
        """The noise of one reading of such quantities, in words."""
        if self.covariance is not None:
            of = "one reading" if len(self.covariance) == len(quantities) else "all readings together"
            alone = [math.sqrt(self.covariance[place][place]) for place in range(len(quantities))]
            text = listing(list(map(_sized, quantities, alone)))
            return f"correlated noise, its covariance given for {of} (standard deviations {text})"
        sizes = {name: self.deviation(name) or 0.0 for name in quantities}
        alike = {"x", "y"} <= sizes.keys() and sizes["x"] == sizes["y"]
        parts = [f"{given_text(sizes['x'], 'm')} per coordinate"] if alike else []
        parts += [_sized(name, size) for name, size in sizes.items() if name == "heading" or not alike]
        return f"{deviations_text(*parts)}{self._growth(quantities)}"

    def _growth(self, quantities: tuple[Quantity, ...]) -> str:
        # How the variance grows with the speed V and the yaw rate Omega.
        causes = (
            ("per_speed", "the speed V", "(kV)²", "k", "m/s"),
            ("per_yaw_rate", "the yaw rate Ω", "(k'Ω)²", "k'", "rad/s"),
        )
        # One for x and y.
        noises = {"heading" if name == "heading" else "position": self.at_least(name) for name in quantities}
        grown: list[tuple[str, str, str]] = []
        for rate, cause, term, factor, unit in causes:
            found = [
                f"{given_text(getattr(noises[name], rate), UNITS[name])} per {unit} in {name}"
                for name in ("position", "heading")
                if name in noises and getattr(noises[name], rate)
            ]
            if found:
                grown.append((cause, term, f"{factor} = {listing(found)}"))
        if not grown:
            return ""
        named, terms, factors = zip(*grown, strict=True)
        return f", growing with {listing(named)} as √(σ² + {' + '.join(terms)}), {', '.join(factors)}"


def _sized(name: Quantity, size: float) -> str:
    return f"{given_text(size, UNITS[name])} in {name}"


class Poses(PlacedSensor):
    """Absolute x, y [m] and heading [rad], or some of them, at every n-th sample.

    Attributes:
        quantities: which of x, y, heading are read.
        noise: of one reading.
    """

    kind: Literal["poses"] = "poses"
    quantities: Annotated[tuple[Quantity, ...], Field(min_length=1)] = ("x", "y", "heading")
    noise: AbsoluteNoise = AbsoluteNoise()

    @property
    def angles(self) -> tuple[int, ...]:
        """The heading's place."""
        return tuple(place for place, name in enumerate(self.quantities) if name == "heading")

    def reading(self, moment: Moment) -> Expression:
        """The quantities, at the lever arm's end."""
        x, y = self.position(moment)
        read = {"x": x, "y": y, "heading": self.pose(moment)[2]}
        return ca.vertcat(*(read[quantity] for quantity in self.quantities))

    def whitening(self, moment: Moment) -> Expression:
        """1 / sigma of each quantity at the moment's twist; the inverse Cholesky factor of a covariance."""
        if self.noise.covariance is not None:
            if self.joint_whitening is not None:
                return ca.SX.eye(len(self.quantities))
            return ca.SX(ca.DM(_inverse_factor(self.noise.covariance)))
        twist = moment.signals["twist"]
        speed, turning = twist[0] ** 2 + twist[1] ** 2, twist[2] ** 2
        own = [self.noise.of(name) or Noise(np.inf) for name in self.quantities]
        variances = [noise.variance(speed, turning) for noise in own]
        return ca.diag(1 / ca.sqrt(ca.vertcat(*variances)))

    @property
    def joint_whitening(self) -> Array | None:
        """The inverse Cholesky factor of a covariance of all readings."""
        given = self.noise.covariance
        return None if given is None or len(given) == len(self.quantities) else _inverse_factor(given)

    @property
    def units(self) -> tuple[str, ...]:
        """The quantities' units."""
        return tuple(UNITS[name] for name in self.quantities)

    @property
    def subject(self) -> str:
        """The quantities."""
        return listing(self.quantities)

    @property
    def noise_text(self) -> str:
        """Quantity by quantity, and how it grows."""
        return self.noise.text(self.quantities)

    def brief(self, samples: int) -> str:
        """How many are read, and what of them."""
        given = set(self.quantities)
        noun = "pose" if len(given) == 3 else "heading" if given == {"heading"} else "position"
        times = count(len(self.columns(samples)), noun)
        return times if noun == "heading" else f"{times} ({listing(self.quantities)})"

    @property
    def noises(self) -> dict[str, Noise]:
        """The noise of each quantity; {} of a covariance."""
        own = {name: self.noise.of(name) for name in self.quantities}
        return {name: noise for name, noise in own.items() if noise is not None}

    @property
    def mount(self) -> Mount:
        """The lever arm's end. An arm of 0 is one that nobody gave: a sensor seldom sits where it should."""
        arm = self.lever_arm
        known = {} if arm.deviation is None else dict.fromkeys(("sensor_x", "sensor_y"), arm.deviation)
        return Mount((arm.x, arm.y, 0.0), arm.known and bool(arm.x or arm.y), known)

    def flaws(self, system: System, samples: int) -> list[Flaw]:
        """Quantities without noise or given twice, a covariance of another size."""
        flaws, noise = [], self.noise
        if len(set(self.quantities)) < len(self.quantities):
            flaws.append(Flaw(("measurement", "quantities"), "a quantity is listed twice"))
        if noise.covariance is not None:
            alone = len(self.quantities)
            together = alone * len(self.columns(samples))
            if len(noise.covariance) not in (alone, together):
                got = len(noise.covariance)
                text = f"expected {alone} rows (one pose) or {together} (all readings), got {got}"
                flaws.append(Flaw(("measurement", "noise", "covariance"), text))
            return flaws
        missing: list[str] = [name for name in self.quantities if noise.deviation(name) is None]
        if missing:
            if {"x", "y"} <= set(missing):
                missing = ["position", *(name for name in missing if name == "heading")]
            example = ", ".join(f"{name}: {USUAL[UNITS[name]]}" for name in missing)
            text = f"the noise of {listing(missing)} is needed to weight the readings: noise: {{{example}}}"
            flaws.append(Flaw(("measurement", "noise"), text))
        return flaws


def _inverse_factor(covariance: Matrix) -> Array:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(np.array(covariance))))
