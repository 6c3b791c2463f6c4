"""Odometry drift: what a robot moves by beside what its inputs say, a random walk of its pose."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, field_validator, model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue, ProblemError
from oed.foundation.quantities import Angle, Length, require_covariance
from oed.foundation.shown import written
from oed.foundation.text import given_text, listing
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System, step_symbols
from oed.kernel.measurement.process_noise import Period, ProcessNoise
from oed.kernel.measurement.sensor import Sensor
from oed.robots.models.arcs import after_arc
from oed.robots.models.model import Model, robot_of

AT_REST = 1e-3
"""Speed [m/s] and yaw rate [rad/s] as which a robot at rest counts: |V| is sqrt(V^2 + 1e-6), smooth at 0."""
Rate = Annotated[Length, Field(ge=0)]
Turning = Annotated[Angle, Field(ge=0)]
ERRORS = ("ahead", "sideways", "heading")
"""What errs in a period, (3,)."""
CAUSES = {"per_metre": "1 m", "per_radian": "1 rad of turning", "per_root_second": "1 s"}
"""What drift grows with the root of, and how much of it the deviations given are of."""


class Drift(Component, ProcessNoise):
    """The motion of every period errs by w ~ N(0, Q), ahead, to the left and in its turn, evenly in it.

    Variances grow in proportion to the path, to the turning and to the time, so that deviations grow with
    their roots; those after 1 m, 1 rad and 1 s are given [Thrun, Burgard, Fox: Probabilistic robotics, 2005,
    section 5.4; its alpha_1 is heading_per_radian^2, alpha_2 heading_per_metre^2, alpha_3 ahead_per_metre^2,
    alpha_4 ahead_per_radian^2].

    Attributes:
        ahead_per_metre, ahead_per_radian, ahead_per_root_second: of the way ahead [m].
        sideways_per_metre, sideways_per_radian, sideways_per_root_second: of the way to the left [m].
        heading_per_metre, heading_per_radian, heading_per_root_second: of the turn [rad].
        covariance: instead, of all three after 1 s, (3, 3), in SI units, whatever the motion.
    """

    ahead_per_metre: Rate = 0.0
    ahead_per_radian: Rate = 0.0
    ahead_per_root_second: Rate = 0.0
    sideways_per_metre: Rate = 0.0
    sideways_per_radian: Rate = 0.0
    sideways_per_root_second: Rate = 0.0
    heading_per_metre: Turning = 0.0
    heading_per_radian: Turning = 0.0
    heading_per_root_second: Turning = 0.0
    covariance_rate: tuple[tuple[float, ...], ...] | None = None
    signal: ClassVar[str] = "twist"
    walks: ClassVar[str] = "Its pose is a random walk"

    @field_validator("covariance_rate")
    @classmethod
    def _is_a_covariance(cls, rows: tuple[tuple[float, ...], ...] | None) -> Any:
        if rows is not None:
            require_covariance(rows)
            if len(rows) != len(ERRORS):
                raise ValueError(f"expected 3 rows ({', '.join(ERRORS)}), got {len(rows)}")
        return rows

    @model_validator(mode="after")
    def _one_way_to_give_it(self) -> Drift:
        others = [name for name, value in self if name != "covariance_rate" and value]
        if self.covariance_rate is not None and others:
            raise ValueError(f"a covariance_rate says it all: omit {', '.join(others)}")
        return self

    @property
    def present(self) -> bool:
        """Whether there is any."""
        return self.covariance_rate is not None or bool(self.rates.any())

    @property
    def rates(self) -> Array:
        """Variances of (ahead, sideways, heading) per metre, radian and second, (3, 3), SI."""
        return np.array([[getattr(self, f"{name}_{cause}") ** 2 for cause in CAUSES] for name in ERRORS])

    @property
    def size(self) -> int:
        """3."""
        return len(ERRORS)

    def covariance(self, period: Period) -> Expression:
        """Variances by the mean twist of the period: per metre of |V| T, per radian of |Omega| T, per T."""
        if self.covariance_rate is not None:
            return period.duration * ca.DM(self.covariance_rate)
        return ca.diag(ca.DM(self.rates) @ _amounts(period))

    def step(self, period: Period, errors: Expression) -> Expression:
        """The pose on the arc of the twist with errors / T; what is towed follows, own speeds are kept."""
        system, state, inputs, parameters, duration = period
        robot = robot_of(system)
        twist, further = robot.motion(state, inputs, parameters, duration)
        moved = twist + errors / duration
        if robot.towed is not None:
            further = robot.internal_step(state, moved, parameters, duration)
        return after_arc(state, moved, further, duration, robot.integration)

    def issues(self, system: System) -> list[Issue]:
        """Of what is no robot."""
        if isinstance(system, Model):
            return []
        return [Issue(("measurement", "drift"), f"{system.noun}s have no odometry that drifts")]

    @property
    def text(self) -> str:
        """Deviations after 1 m, 1 rad and 1 s."""
        if self.covariance_rate is not None:
            sizes = np.sqrt(np.diag(self.covariance_rate))
            each = [_sized(name, float(size)) for name, size in zip(ERRORS, sizes, strict=True)]
            return f"{listing(each)} after 1 s, correlated, whatever the motion"
        parts = []
        for cause, amount in CAUSES.items():
            given = {name: float(getattr(self, f"{name}_{cause}")) for name in ERRORS}
            each = [_sized(name, size) for name, size in given.items() if size]
            parts += [f"{listing(each)} after {amount}"] if each else []
        return f"{', '.join(parts)}; it grows with the root of {'either' if len(parts) > 1 else 'that'}"


@lru_cache(maxsize=16)
def amounts_of(robot: System) -> ca.Function:
    """The function (state, inputs, parameters, period) -> path [m], turning [rad] and time [s] of a period,
    (3,), which the variances of drift are in proportion to.
    """
    period = Period(robot, *step_symbols(robot))
    return ca.Function("amounts", [*period[1:]], [ca.densify(_amounts(period))])


def _amounts(period: Period) -> Expression:
    system, *given = period
    twist = system.signals(*given)["twist"]
    square = AT_REST**2
    speed = ca.sqrt(twist[0] ** 2 + twist[1] ** 2 + square)
    return period.duration * ca.vertcat(speed, ca.sqrt(twist[2] ** 2 + square), 1)


def _sized(name: str, size: float) -> str:
    return (
        f"{given_text(size, 'rad' if name == 'heading' else 'm')} {'in ' if name == 'heading' else ''}{name}"
    )


USUAL = Drift(
    ahead_per_metre=0.003,
    sideways_per_metre=0.001,
    heading_per_metre=float(np.radians(0.15)),
    heading_per_radian=float(np.radians(0.4)),
)
"""Such as robots usually have: what windows of 4 s show of a differential drive in a laboratory, in five
sessions of github.com/sousarbarb/optiodom: 0.6 to 4 mm ahead and 1 to 2 mm sideways after 1 m, 0.05 to 0.3
deg after 1 m and 0.25 to 0.8 deg after 1 rad of turning. What slips or steers drifts more, and shows it: a
tricycle there 20 to 110 mm ahead, a Husky outdoors (github.com/norlab-ulaval/DRIVE) 300 mm."""


class DriftRecord(Component):
    """The drift that `oed estimate` reports of logs of the same robot.

    Attributes:
        record: the estimate's folder (or file), found from the study's folder.
    """

    record: str


def _form(value: Any) -> str:
    # By what is given, so that mistakes are those of the form that was meant.
    if isinstance(value, str):
        return "by a word"
    named = "record" in value if isinstance(value, dict) else isinstance(value, DriftRecord)
    return "from a record" if named else "as numbers"


def _usual(value: str) -> str:
    if value != "usual":
        amounts = "its amounts, like {ahead_per_metre: 3 mm, heading_per_metre: 0.15 deg}"
        raise ValueError(f"expected usual, or {amounts}, got {written(value)}")
    return value


AnyDrift = Annotated[
    Annotated[Drift, Tag("as numbers")]
    | Annotated[DriftRecord, Tag("from a record")]
    | Annotated[Literal["usual"], BeforeValidator(_usual), Tag("by a word")],
    Discriminator(_form),
]


class DriftingSensor(Sensor):
    """A sensor of a robot that drifts, or may.

    Attributes:
        drift: of the robot's odometry, one for all sensors; "usual" for such as robots usually have.
    """

    drift: AnyDrift | None = None

    @property
    def process_noise(self) -> Drift | None:
        """The drift, where there is any.

        Raises:
            ProblemError: it is named by a record that nobody has read.
        """
        if isinstance(self.drift, DriftRecord):
            text = "a record is read where a study is loaded from a file; here give the numbers"
            raise ProblemError.about(("measurement", "drift", "record"), text)
        found = USUAL if self.drift == "usual" else self.drift
        return found if isinstance(found, Drift) and found.present else None

    def steady(self) -> Self:
        """Of a robot that does not drift."""
        return self if self.drift is None else self.model_copy(update={"drift": None})

    @property
    def drift_remark(self) -> str:
        """The drift, to follow what is said of the readings; "" for none."""
        return "" if self.process_noise is None else f"; the robot drifts by {self.process_noise.text}"
