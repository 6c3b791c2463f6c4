"""What moves: the Model seam, and the planar step that every robot shares.

A robot names its inputs and parameters and says which body twist they ask for; one that needs time to follow
also says what it does instead, from its state. Pose integration, design matrices and derivatives follow.
Expressions are CasADi's, for one sample; the callers map them over time.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from oed.foundation.arrays import Array
from oed.foundation.component import Component
from oed.foundation.errors import Issue, UserMistake
from oed.foundation.own.code import in_words
from oed.foundation.quantities import Length
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import Input, Parameter, System, follows_state, label_of
from oed.robots.models.arcs import Integration, after_arc, chord
from oed.robots.models.coefficients import coefficient_parameters, coefficient_twist
from oed.robots.models.plausibility import size_issues
from oed.robots.models.rates import RATES

if TYPE_CHECKING:
    from oed.kernel.problem import Problem


class Model(Component, System):
    """A planar robot: state (x, y, heading, ...), inputs, parameters and the body twist they give.

    Attributes:
        body_radius: distance from the robot's origin to the farthest point of its body [m]: how far from
            walls and obstacles its origin has to stay.
    """

    kind: str
    body_radius: Annotated[Length, Field(ge=0)] = 0.0
    states: ClassVar[tuple[str, ...]] = ("x", "y", "heading")
    state_units: ClassVar[tuple[str, ...]] = ("m", "m", "rad")
    noun: ClassVar[str] = "robot"
    start_name: ClassVar[str] = "initial_pose"
    motion_signal: ClassVar[str] = "twist"
    velocity_signal: ClassVar[str] = "twist"
    renamed: ClassVar[Mapping[str, str]] = {"pose": "state", "poses": "states", "model": "system"}
    coefficient_names: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Names of the coefficient matrix's entries, row by row; () for a twist that is not linear in any."""
    sideways: ClassVar[bool] = False
    """Whether it drives sideways as well as ahead."""
    skids: ClassVar[bool] = False
    """Whether it turns by sliding over the ground, which nobody can tell from its geometry."""
    short_forms: ClassVar[tuple[str, ...]] = ()
    """Keys that stand for several parameters at once."""
    _integration: Integration = PrivateAttr("arc")
    _finer: int = PrivateAttr(1)

    @property
    def integration(self) -> Integration:
        """The rule by which its pose follows from its twist."""
        return self._integration

    def system(self, rule: Integration) -> Self:
        """This robot with the rule by which its pose follows from its twist.

        Args:
            rule: "arc", exact for a twist that is constant over a period, or "midpoint", the paper's
                [Choi, eq. 8].
        """
        if rule == self.integration:
            return self
        other = self.model_copy()
        other._integration = rule
        return other

    @property
    def integrates(self) -> bool:
        """Whether its twist changes within a period, for which an arc stands."""
        return self.integration == "arc" and follows_state(self)

    def refined(self, times: int) -> Self:
        """This robot with so many times more steps in a period.

        Args:
            times: factor, at least 1.
        """
        other = self.model_copy()
        other._finer = times * self._finer
        return other

    @property
    def refinement(self) -> tuple[Self, int]:
        """This robot with its own steps, and how many times more there are."""
        coarse = self.model_copy()
        coarse._finer = 1
        return coarse, self._finer

    def doubts(self, problem: Problem) -> Sequence[Issue]:
        """Durations, rooms, robots and noise of sizes that no robot has: a unit is missing, or wrong."""
        return tuple(size_issues(self, problem))

    @abstractmethod
    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Body twist (3,): forward speed [m/s], lateral speed to the left [m/s], yaw rate [rad/s].

        What the inputs ask for: where they are held for long, the robot moves so.

        Args:
            inputs: one sample's inputs, (len(self.inputs),).
            parameters: parameter values, (len(self.parameters),), SI.
        """

    def coefficients(self, parameters: Expression) -> Expression:
        """Coefficient matrix c of [yaw rate; forward speed] = c @ effective inputs [Choi, eqs 5, 6].

        A robot that also moves sideways has a third row, for the lateral speed.

        Raises:
            NotImplementedError: the twist is not linear in any coefficients.
        """
        raise NotImplementedError(f"the twist of {self.kind} is not linear in coefficients")

    def effective_inputs(self, inputs: Expression, parameters: Expression) -> Expression:
        """Inputs as they act on the ground, e.g. wheel speeds less slip; the inputs themselves by default."""
        return inputs

    def mean_twist(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The constant twist (3,) that stands for a period of `period` [s], 0 for the instant itself.

        What the robot makes, from `state` on, of the `twist` (3,) that its inputs ask for; by default just
        that. Heading and pose follow from it.

        Args:
            state: at the begin of the period, (states,).
            twist: that the inputs ask for, (3,).
            parameters: values, (p,), SI.
            period: [s].
        """
        return twist

    def internal_step(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """Next values of the states after (x, y, heading), for a period's mean twist (3,), of `period` [s].

        A period of no time changes nothing, and has finite derivatives.

        Args:
            state: at the begin of the period, (states,).
            twist: mean twist of the period, (3,).
            parameters: values, (p,), SI.
            period: [s].
        """
        return ca.SX(0, 1)

    def motion(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> tuple[Expression, Expression]:
        """Mean twist (3,) of a period, and next values of the states after (x, y, heading).

        By default those of what the inputs ask for. A robot whose inputs are forces says here what follows.

        Args:
            state: at the begin of the period, (states,).
            inputs: held in it, (inputs,), SI.
            parameters: values, (p,), SI.
            period: [s], 0 for the instant itself.
        """
        twist = self.mean_twist(state, self.twist(inputs, parameters), parameters, period)
        return twist, self.internal_step(state, twist, parameters, period)

    def step(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The pose after an arc, or its chord, and the further states, shared by all robots."""
        lasting = period / self._finer
        for _ in range(self._finer):
            twist, further = self.motion(state, inputs, parameters, lasting)
            state = after_arc(state, twist, further, lasting, self.integration)
        return state

    def signals(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Mapping[str, Expression]:
        """What the robot does in a period.

        - twist: forward and lateral speed [m/s], yaw rate [rad/s] of its motion (3,);
        - effective_inputs: the inputs as they act on the ground (q,);
        - gain, direction: displacement per unit of speed [s], and its heading [rad].
        """
        twist, _ = self.motion(state, inputs, parameters, period)
        gain, direction = chord(twist[2], state[2], period, self.integration)
        return {
            "twist": twist,
            "effective_inputs": self.effective_inputs(inputs, parameters),
            "gain": gain,
            "direction": direction,
        }

    def issues(self) -> list[Issue]:
        """Why what its class gives as its twist is none; [] where it is one."""
        inputs, parameters = ca.SX.sym("inputs", len(self.inputs)), ca.SX.sym("p", len(self.parameters))
        try:
            twist = ca.SX(self.twist(inputs, parameters))
        except Exception as error:
            # A class of the user's own may fail in any way.
            return [Issue(("robot",), f"its twist cannot be made: {in_words(error, 200)}")]
        text = "expected a twist (3, 1): forward speed, lateral speed, yaw rate; got one of shape"
        return [] if twist.shape == (3, 1) else [Issue(("robot",), f"{text} {twist.shape}")]

    @property
    def estimable(self) -> Mapping[str, tuple[str, ...]]:
        """Its parameters, and where it has any its coefficients."""
        coefficients = tuple(name for row in self.coefficient_names for name in row)
        return {**super().estimable, **({"coefficients": coefficients} if coefficients else {})}

    def remedy(self, unbounded: Input, limits: Sequence[str]) -> str:
        """The limit on the wheel, the steering or the motion that bounds an input."""
        motion = {"m/s": "body_speed", "rad/s": "yaw_rate"}.get(unbounded.unit)
        if unbounded.quantity in RATES:
            return f"add {unbounded.quantity}"
        if motion is not None and motion not in limits:
            return f"add {motion}"
        own = f"no limit but your own (input_bounds) bounds a {unbounded.quantity} [{unbounded.unit}]"
        reason = own if motion is None else f"{motion} does not, for the motion does not follow linearly"
        return f"{reason}: make it a wheel_speed and add that"

    def lever(self, entry: Input) -> float:
        """The nominal radius [m] of the wheel that an input turns, by its place's name or that of all."""
        if entry.quantity != "wheel_speed":
            return 0.0
        place = entry.name.removeprefix("wheel_speed")
        radii = (getattr(self, name, None) for name in (f"wheel_radius{place}", "wheel_radius"))
        return next((one for one in radii if one), 0.0)

    def allows(self, values: Mapping[str, float]) -> bool:
        """Whether there is a robot with these values of parameters, SI."""
        try:
            self.with_values(values)
        except ValueError:
            return False
        return True

    def long_names(self, name: str) -> tuple[str, ...]:
        """Of a key that stands for both sides, the parameters of both."""
        sides = (f"{name}_right", f"{name}_left")
        own = set(super().estimable["parameters"])
        return sides if name in self.short_forms and set(sides) <= own else (name,)

    @property
    def predictions(self) -> Mapping[str, tuple[str, ...]]:
        """The position, both coordinates together, and the heading."""
        return {"position": ("x", "y"), "heading": ("heading",)}

    @property
    def exact(self) -> Self:
        """The robot on arcs."""
        return self.system("arc")

    @property
    def chosen_states(self) -> int:
        """The pose alone."""
        return len(Model.states)

    @property
    def as_far_as_velocity(self) -> bool:
        """On exact arcs, unless the twist changes within a period: chords of the midpoint rule are bent."""
        return self.integration == "arc" and not follows_state(self)

    def with_values(self, values: Mapping[str, float]) -> Self:
        """This robot with other nominal values of parameters, SI.

        Raises:
            ValueError: no such parameter, or a value that the robot cannot have.
        """
        nominal = {parameter.name: parameter.nominal for parameter in self.parameters}
        strangers = [name for name in values if name not in nominal]
        if strangers:
            raise ValueError(f"expected parameters ({', '.join(nominal)}), got {', '.join(strangers)}")
        given = self.model_dump(exclude_none=True, exclude=set(self.short_forms))
        other = type(self).model_validate({**given, **nominal, **values}).system(self.integration)
        return other.refined(self._finer)

    def estimating(self, names: Collection[str]) -> Model:
        """The robot that has the parameters `names`: itself, or the same seen through its coefficients.

        Itself too where it has no coefficients.
        """
        known = {parameter.name for parameter in self.parameters}
        return self if set(names) <= known or not self.coefficient_names else self.by_coefficients

    @property
    def by_coefficients(self) -> Model:
        """The robot seen through its coefficients."""
        return CoefficientRobot(base=self).refined(self._finer)

    @property
    def physical(self) -> Model:
        """The robot with its physical constants as parameters: itself, unless seen through coefficients."""
        return self

    @property
    def body_width(self) -> float:
        """Width of its body, roughly [m]: its `track`; 0 where its geometry says nothing of it."""
        track = getattr(self, "track", 0.0)
        return track if isinstance(track, float) else 0.0

    @property
    def towed(self) -> tuple[float, float] | None:
        """Of a robot with a trailer how far behind its origin the hitch is, and the axle behind that [m]."""
        return None

    def body(self, states: Array) -> Array:
        """Positions (n, joints, 2) [m] of what it tows, in these states (n, states): hitch and axle."""
        return np.zeros((len(states), 0, 2))


def _of_the_base(name: str) -> Any:
    return property(lambda robot: getattr(robot.base, name))


class CoefficientRobot(Model):
    """The robot `base` with the entries of c [Choi, eq. 5] as parameters, its other constants nominal.

    It answers what an estimate of c means for the motion, e.g. which headings it predicts.
    """

    kind: Literal["coefficients"] = "coefficients"
    base: Model

    @model_validator(mode="before")
    @classmethod
    def _body_of_the_base(cls, data: dict[str, Any]) -> dict[str, Any]:
        return {"body_radius": data["base"].body_radius, **data}

    @property
    def integration(self) -> Integration:
        """The base robot's."""
        return self.base.integration

    def system(self, rule: Integration) -> Self:
        """Its base with that rule, seen so."""
        return self.model_copy(update={"base": self.base.system(rule)})

    inputs: ClassVar[Any] = _of_the_base("inputs")
    states: ClassVar[Any] = _of_the_base("states")
    state_units: ClassVar[Any] = _of_the_base("state_units")
    coefficient_names: ClassVar[Any] = _of_the_base("coefficient_names")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The coefficients, row by row: yaw rate [1], then forward and lateral speed [m]."""
        return coefficient_parameters(self.base)

    def coefficients(self, parameters: Expression) -> Expression:
        """The parameters as the matrix c."""
        rows, columns = len(self.coefficient_names), len(self.coefficient_names[0])
        return ca.reshape(parameters, columns, rows).T

    def lever(self, entry: Input) -> float:
        """The base robot's."""
        return self.base.lever(entry)

    def effective_inputs(self, inputs: Expression, parameters: Expression) -> Expression:
        """Inputs as they act on the ground at the base robot's nominal constants."""
        return self.base.effective_inputs(inputs, ca.DM(self.base.nominal))

    def mean_twist(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The constant twist of a period at the base robot's nominal constants."""
        return self.base.mean_twist(state, twist, ca.DM(self.base.nominal), period)

    def internal_step(
        self, state: Expression, twist: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """Next values of the further states at the base robot's nominal constants."""
        return self.base.internal_step(state, twist, ca.DM(self.base.nominal), period)

    def twist(self, inputs: Expression, parameters: Expression) -> Expression:
        """Forward speed, 0, yaw rate [Choi, eq. 5]."""
        return coefficient_twist(self, inputs, parameters)

    def allows(self, values: Mapping[str, float]) -> bool:
        """Any coefficients are those of some robot."""
        return True

    def estimating(self, names: Collection[str]) -> Model:
        """The robot that has the parameters `names`: this one, unless they are the base robot's own."""
        known = {parameter.name for parameter in self.parameters}
        return self if set(names) <= known else self.base.estimating(names)

    @property
    def by_coefficients(self) -> Model:
        """This robot."""
        return self

    @property
    def physical(self) -> Model:
        """The base robot."""
        return self.base


def robot_of(system: System) -> Model:
    """A system that has to be a robot.

    Raises:
        UserMistake: it is none.
    """
    if isinstance(system, Model):
        return system
    raise UserMistake(f"{label_of(system)} is no robot: it has no pose, wheels or twist")
