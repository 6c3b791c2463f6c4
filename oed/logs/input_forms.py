"""Forms in which robots log their inputs: speeds, angles, ticks; each becomes a time integral.

An angle's or a counter's range is unwrapped; a wheel may be logged by the speed or the way of its rim.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import FileIssue
from oed.foundation.quantities import Length, parse_quantity
from oed.foundation.text import given_text
from oed.kernel.dynamics.system import Input, System
from oed.logs.findings import wild_reading
from oed.logs.integrals import Held, Turned, counted, held_integral, summed
from oed.logs.log import Finding
from oed.logs.series import Series

WHEEL = "wheel_speed"
"""The quantity of inputs that are wheels' speeds, which have rims."""
HALF_TURN = np.pi
"""A steering angle that jumps by more is one that begins anew [rad]."""


class InputForm(Component, ABC):
    """The form of one of the robot's inputs in a log.

    Attributes:
        sign: -1 where the log counts the other way round.
    """

    sign: Literal[1, -1] = 1

    @abstractmethod
    def turned(self, series: Series, place: int, entry: Input, lever: float, label: str) -> Turned:
        """The input's time integral.

        Args:
            series: the logged inputs.
            place: of this one in its values.
            entry: the robot's input that it is.
            lever: radius of the wheel that it turns, by the robot [m]; 0 of none.
            label: what it is called in the log, for issues.
        """

    @abstractmethod
    def reason_against(self, entry: Input, lever: float) -> tuple[str, str]:
        """The key for which it cannot be this input of the robot, and why; "" where it can."""

    def ends_needed(self, entry: Input) -> tuple[bool, bool]:
        """Whether the first and the last row of a drive have a say in its integral."""
        return True, True

    def by_rim(self, entry: Input) -> bool:
        """Whether a wheel is logged by its rim, in a unit of length, and the robot says of which radius."""
        return False

    @property
    def needs_every_row(self) -> bool:
        """Whether motion is lost with every row that is left out."""
        return False


class _WithUnit(InputForm, ABC):
    """A form with a unit.

    Attributes:
        unit: e.g. "deg/s", "rpm"; SI by default. Of a wheel also of its rim: "m/s", "mm", ...
        radius: of the wheel, where the unit is that of its rim; the robot's nominal one by default.
    """

    unit: str | None = None
    radius: Annotated[Length, Field(gt=0)] | None = None

    def by_rim(self, entry: Input) -> bool:
        """Whether the unit is that of a rim, and `radius` does not say of which."""
        return self.radius is None and self._of_rim(entry)

    def _si(self, entry: Input) -> str:
        return entry.unit

    def _of_rim(self, entry: Input) -> bool:
        si = self._si(entry)
        of_wheel = entry.quantity == WHEEL and bool(unit_reason(self.unit, si))
        return of_wheel and not unit_reason(self.unit, _rim(si))

    def _factor(self, entry: Input, lever: float) -> float:
        si = self._si(entry)
        if not self._of_rim(entry):
            return self.sign * unit_factor(self.unit, si)
        return self.sign * unit_factor(self.unit, _rim(si)) / (self.radius or lever)

    def _reason(self, entry: Input, lever: float) -> tuple[str, str]:
        if not self._of_rim(entry):
            reason = unit_reason(self.unit, self._si(entry))
            if reason or self.radius is None:
                return "unit", reason
            if entry.quantity != WHEEL:
                return "radius", f"is that of a wheel's rim, and {entry.name} has none; leave it out"
            return "radius", "is that of a rim; give the rim's `unit`, e.g. m/s"
        if not (self.radius or lever):
            return "unit", f"{self.unit} is the speed of a rim; say of which `radius` the wheel is"
        return "", ""


class SpeedForm(_WithUnit):
    """An input's own value: a wheel's speed, a steering angle.

    Attributes:
        form: "speed" of what drives the robot, "value" of an angle; by the input where not given.
        held: "next" for a value that holds until the next row (default of speeds), "previous" for a mean
            since the row before, "between" for straight lines between rows (default of angles).
    """

    form: Literal["speed", "value"] | None = None
    held: Held | None = None

    def turned(self, series: Series, place: int, entry: Input, lever: float, label: str) -> Turned:
        """Integrated as held."""
        values = self._factor(entry, lever) * series.values[:, place]
        issues = [] if entry.drives else _begun_anew(series, values, label)
        wild = wild_reading(series, place, label, self.unit or entry.unit) if entry.drives else None
        found = () if wild is None else (wild,)
        return Turned(
            held_integral(series.times, values, self._held(entry)), issues=tuple(issues), found=found
        )

    def reason_against(self, entry: Input, lever: float) -> tuple[str, str]:
        """The wrong form or unit."""
        fitting = "speed" if entry.drives else "value"
        if self.form not in (None, fitting):
            return "form", f"{entry.name} is in {entry.unit}; its form is {fitting}, got {self.form!r}"
        return self._reason(entry, lever)

    def ends_needed(self, entry: Input) -> tuple[bool, bool]:
        """A value that holds to the next row is not used in the last one, a mean not in the first."""
        return self._held(entry) != "previous", self._held(entry) != "next"

    def _held(self, entry: Input) -> Held:
        return self.held or ("next" if entry.drives else "between")


class AngleForm(_WithUnit):
    """The angle that a wheel has turned, or that a steered one has; unwrapped or with a range.

    Attributes:
        form: "angle". Its unit is "deg", "rad", "turn", ...; of what drives in m/s a length.
        wrap: full range in this unit where the angle begins anew, e.g. 360.
        zero: what a steering encoder shows straight ahead, in this unit.
    """

    form: Literal["angle"]
    wrap: Annotated[float, Field(gt=0)] | None = None
    zero: float = 0.0

    def turned(self, series: Series, place: int, entry: Input, lever: float, label: str) -> Turned:
        """What a wheel has turned since the first row; a steering angle joined by straight lines."""
        found = counted(series, place, label, self.wrap)
        return _integrated(found, series, place, entry, self._factor(entry, lever), self)

    def reason_against(self, entry: Input, lever: float) -> tuple[str, str]:
        """The wrong unit, or a wheel that is said to be steered."""
        reason = _zero_of_a_wheel(self, entry)
        return ("zero", reason) if reason else self._reason(entry, lever)

    def _si(self, entry: Input) -> str:
        return entry.unit.removesuffix("/s")


class TicksForm(InputForm):
    """An encoder's ticks.

    Attributes:
        form: "ticks".
        ticks_per_turn: of the encoder.
        gear: turns of the encoder per turn of the wheel.
        cumulative: whether the ticks add up; else each row has those since the row before, and a steered
            wheel stands straight ahead in the first row.
        wrap: range after which a cumulative counter begins anew, e.g. 65536.
        zero: what a steering encoder shows straight ahead, in ticks.
    """

    form: Literal["ticks"]
    ticks_per_turn: Annotated[float, Field(gt=0)]
    gear: Annotated[float, Field(gt=0)] = 1.0
    cumulative: bool = False
    wrap: Annotated[float, Field(gt=0)] | None = None
    zero: float = 0.0

    def turned(self, series: Series, place: int, entry: Input, lever: float, label: str) -> Turned:
        """Every tick counted once."""
        angle = self.sign * 2 * np.pi / (self.ticks_per_turn * self.gear)
        if self.cumulative:
            found = counted(series, place, label, self.wrap)
            return _integrated(found, series, place, entry, angle, self)
        turned = angle * summed(series.values[:, place])
        if not entry.drives:
            return Turned(held_integral(series.times, turned, "between"))
        wild = wild_reading(series, place, label, "ticks")
        return Turned(turned, found=() if wild is None else (wild,))

    def reason_against(self, entry: Input, lever: float) -> tuple[str, str]:
        """Not of a wheel, or a range or a zero of something that does not add up."""
        for key in ("wrap", "zero"):
            if getattr(self, key) and not self.cumulative:
                return key, f"`{key}` is of a cumulative counter; add `cumulative: true`"
        reason = _zero_of_a_wheel(self, entry)
        if reason:
            return "zero", reason
        turns = entry.unit in ("rad/s", "rad")
        return "form", "" if turns else f"{entry.name} is in {entry.unit}; ticks count turns"

    def ends_needed(self, entry: Input) -> tuple[bool, bool]:
        """Ticks of the first row fell before the drive."""
        return self.cumulative, True

    @property
    def needs_every_row(self) -> bool:
        """Ticks since the row before are in no other row."""
        return not self.cumulative


Counter = AngleForm | TicksForm


def _integrated(
    found: Turned, series: Series, place: int, entry: Input, factor: float, form: Counter
) -> Turned:
    # A wheel's angle is an integral already; a steering angle, counted from straight ahead, has one.
    if entry.drives:
        return Turned(factor * found.integral, True, found.wraps, found.issues)
    first = series.values[0, place] - form.zero
    if form.wrap is not None:
        first -= form.wrap * np.round(first / form.wrap)
    angles = factor * (first + found.integral)
    return Turned(held_integral(series.times, angles, "between"), False, found.wraps, found.issues)


def _begun_anew(series: Series, angles: Array, label: str) -> list[FileIssue]:
    # A steering angle that wraps is no value: between two rows it would run all the way back.
    rows = np.flatnonzero(np.abs(np.diff(angles)) > HALF_TURN).tolist()
    text = (
        "the steering angle jumps by {:.4g} deg; if it begins anew, say `form: angle` and `wrap:` its range"
    )
    return [
        series.issue(row + 1, label, text.format(np.degrees(abs(angles[row + 1] - angles[row]))))
        for row in rows
    ]


def _zero_of_a_wheel(form: Counter, entry: Input) -> str:
    text = "is that of a steered wheel; what a driven one has turned counts"
    return text if form.zero and entry.drives else ""


def rims(forms: Iterable[tuple[Input, InputForm]], model: System) -> Finding | None:
    """Which wheels' rims were taken for those of nominal radii; None where no log has rims."""
    own = [entry for entry, form in forms if form.by_rim(entry)]
    if not own:
        return None
    radii = " and ".join(f"{entry.name} by {given_text(model.lever(entry), 'm')}" for entry in own)
    text = f"the wheels are logged by their rims, turned into angles by the nominal radii: {radii}"
    return Finding("rim_speeds", text)


def unit_factor(unit: str | None, si: str) -> float:
    """SI units in one `unit`; 1 where none is given.

    Raises:
        ValueError: unknown, or of another kind.
    """
    return 1.0 if unit is None else parse_quantity(f"1 {unit}", si)


def unit_reason(unit: str | None, si: str) -> str:
    """Why a unit is not one of the kind of `si`; "" where it is."""
    try:
        unit_factor(unit, si)
    except ValueError as error:
        # As the study has it, without the number that it was tried with.
        return str(error).replace(f"'1 {unit}'", f"{unit!r}")
    return ""


def _rim(si: str) -> str:
    return si.replace("rad", "m")
