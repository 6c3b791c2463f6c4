"""How noisy poses are: by standard deviations that may grow with speed and yaw rate, or by a covariance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.quantities import Angle, Duration, Length, LengthPerYawRate, Unit, require_covariance
from oed.foundation.text import given_text, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.measurement.description import deviations_text
from oed.robots.sensors.logged import Noise

Matrix = tuple[tuple[float, ...], ...]
Quantity = Literal["x", "y", "heading"]
UNITS = {"x": "m", "y": "m", "position": "m", "heading": "rad"}
"""SI units of what poses have."""
USUAL = {"m": "1 cm", "rad": "1 deg"}
"""Usual noise by its SI unit, for examples."""
AnglePerSpeed = Annotated[float, Unit("rad*s/m", "2 deg*s/m")]


class Discrepancy(Component):
    """What the robot's model cannot say of a pose, as a standard deviation that grows with the twist: slip
    outside the model shows in residuals of whole drives, the more the faster the robot drives and turns.

    Attributes:
        position_per_speed: k_v in the variance (k_v V)^2 + (k_w Omega)^2 of a position, V the speed [s].
        heading_per_speed: the same of a heading [rad s/m].
        position_per_yaw_rate: k_w there, Omega the yaw rate [m s/rad].
        heading_per_yaw_rate: the same of a heading [s].
    """

    position_per_speed: Annotated[Duration, Field(ge=0)] = 0.0
    heading_per_speed: Annotated[AnglePerSpeed, Field(ge=0)] = 0.0
    position_per_yaw_rate: Annotated[LengthPerYawRate, Field(ge=0)] = 0.0
    heading_per_yaw_rate: Annotated[Duration, Field(ge=0)] = 0.0


class DiscrepancyRecord(Component):
    """The discrepancy that residuals of an estimate show: `oed estimate` of a pilot drive.

    Attributes:
        record: the estimate's folder (or file), found from the study's folder.
    """

    record: str


def _form(value: Any) -> str:
    # By what is given, so that mistakes are those of the form that was meant.
    named = "record" in value if isinstance(value, dict) else isinstance(value, DiscrepancyRecord)
    return "from a record" if named else "as numbers"


AnyDiscrepancy = Annotated[
    Annotated[Discrepancy, Tag("as numbers")] | Annotated[DiscrepancyRecord, Tag("from a record")],
    Discriminator(_form),
]


class AbsoluteNoise(Component):
    """Errors of one pose, absolute or relative, as standard deviations or as a covariance matrix.

    Attributes:
        position: of x and of y [m]; x and y may be given apart.
        x, y: [m].
        heading: [rad].
        position_per_speed: k_v in the variance sigma^2 + (k_v V)^2 + (k_w Omega)^2 of a position, V the speed
            [s].
        heading_per_speed: the same of a heading [rad s/m].
        position_per_yaw_rate: k_w there, Omega the yaw rate [m s/rad].
        heading_per_yaw_rate: the same of a heading [s], e.g. readings whose times jitter by so much.
        discrepancy: the part that is not the sensor's own, but the model's; it counts in designs and in
            estimates as noise, and simulated physics does not draw it.
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
    discrepancy: AnyDiscrepancy | None = None
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

    def of_each(self, quantities: Sequence[Quantity]) -> dict[str, Noise]:
        """The noise of quantities, as far as it is given; {} of a covariance."""
        own = {name: self.of(name) for name in quantities}
        return {name: noise for name, noise in own.items() if noise is not None}

    def whitening(self, quantities: Sequence[Quantity], speed: Any, yaw_rate: Any) -> Expression:
        """A (q, q) with A R A' = 1: 1 / sigma of each quantity, of a covariance its inverse Cholesky factor;
        unity where that is of all readings together.

        Args:
            quantities: of "x", "y", "heading", q of them.
            speed: V^2 [m^2/s^2].
            yaw_rate: Omega^2 [rad^2/s^2].
        """
        if self.covariance is not None:
            if self.joint_whitening(quantities) is not None:
                return ca.SX.eye(len(quantities))
            return ca.SX(ca.DM(_inverse_factor(self.covariance)))
        own = [self.of(name) or Noise(np.inf) for name in quantities]
        variances = [noise.variance(speed, yaw_rate) for noise in own]
        return ca.diag(1 / ca.sqrt(ca.vertcat(*variances)))

    def joint_whitening(self, quantities: Sequence[Quantity]) -> Array | None:
        """The inverse Cholesky factor of a covariance of all readings."""
        given = self.covariance
        return None if given is None or len(given) == len(quantities) else _inverse_factor(given)

    def issues(self, quantities: Sequence[Quantity], readings: int) -> list[Issue]:
        """Quantities without noise, a covariance of another size than of so many readings, or of one."""
        if self.covariance is not None:
            alone, got = len(quantities), len(self.covariance)
            together = alone * readings
            if got in (alone, together):
                return []
            text = f"expected {alone} rows (one pose) or {together} (all readings), got {got}"
            return [Issue(("measurement", "noise", "covariance"), text)]
        if isinstance(self.discrepancy, DiscrepancyRecord):
            text = "a record is read where a study is loaded from a file; here give the numbers"
            return [Issue(("measurement", "noise", "discrepancy", "record"), text)]
        missing: list[str] = [name for name in quantities if self.deviation(name) is None]
        if not missing:
            return []
        if {"x", "y"} <= set(missing):
            missing = ["position", *(name for name in missing if name == "heading")]
        example = ", ".join(f"{name}: {USUAL[UNITS[name]]}" for name in missing)
        text = f"the noise of {listing(missing)} is needed to weight the readings: noise: {{{example}}}"
        return [Issue(("measurement", "noise"), text)]

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
        size, name = self.deviation(quantity) or 0.0, "heading" if quantity == "heading" else "position"
        return Noise(size, self._growth_of(f"{name}_per_speed"), self._growth_of(f"{name}_per_yaw_rate"))

    @property
    def of_sensor(self) -> AbsoluteNoise:
        """The sensor's own, without the discrepancy."""
        return self.model_copy(update={"discrepancy": None})

    def _growth_of(self, name: str) -> float:
        # The sensor's own and the model's are independent.
        own: float = getattr(self, name)
        return math.hypot(own, getattr(self.discrepancy, name, 0.0))

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


def _inverse_factor(covariance: Matrix) -> Array:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(np.array(covariance))))
