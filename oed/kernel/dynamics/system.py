"""Systems: named inputs, states and parameters, and one step x+ = f(x, u, p, T).

A domain says how its systems step; trajectories, sensitivities, readings and limits follow from that for all
alike. Expressions are CasADi's, of one period; the callers map them over time.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf
from typing import Any, ClassVar

import casadi as ca
import numpy.typing as npt

from oed.foundation.errors import Issue
from oed.foundation.text import Unit
from oed.kernel.dynamics.expression import Expression

FORCES = ("throttle",)
"""Quantities of inputs that accelerate a system, where others say how fast it is."""


@dataclass(frozen=True)
class Input:
    """One input of a system.

    Attributes:
        name: name in files.
        quantity: physical quantity ("voltage", ...); limits apply by quantity.
        unit: SI unit.
        below: magnitude that the system's equations need it to stay below.
    """

    name: str
    quantity: str
    unit: str
    below: float = inf

    @property
    def drives(self) -> bool:
        """True if the input moves the system, as a speed or a throttle does; an angle only shapes motion."""
        return self.unit in ("rad/s", "m/s") or self.pushes

    @property
    def pushes(self) -> bool:
        """True if the input drives by a force: the system has speeds of its own, which follow."""
        return self.quantity in FORCES


ROUNDING = 1e-15
"""Share of a parameter's size, or of 1 where it has none, below which its nominal value is rounding of 0."""


@dataclass(frozen=True)
class Parameter:
    """One constant of a system.

    Attributes:
        name: name in files.
        nominal: value in SI.
        unit: SI unit ("" for a ratio).
        size: reference of a relative precision where the nominal value is 0, SI; 0 for none.
    """

    name: str
    nominal: float
    unit: str
    size: float = 0.0

    @property
    def scale(self) -> float:
        """Size to which a relative precision refers: the nominal value's magnitude, or `size` where that is
        0, or but the rounding of a sine or a cosine.
        """
        return abs(self.nominal) if abs(self.nominal) > ROUNDING * (self.size or 1.0) else self.size


class System(ABC):
    """System that responds to inputs; hashable, for its compiled functions are kept.

    Attributes:
        inputs: held over each period.
        states: names; () of a system whose signals follow from its inputs at once.
        state_units: SI units of the states.
        noun: noun for the system in messages.
        start_name: name of the start states as nuisances.
        motion_signal: name of the signal that limits on the motion look at; "" for none.
        velocity_signal: name of the signal that begins with how fast it moves through the plane, two entries
            [m/s]; "" of one that does not move through space.
        renamed: a domain's own names for parts of a drive or a moment, which can be used too: names
            of their attributes by these.
    """

    inputs: ClassVar[tuple[Input, ...]]
    states: ClassVar[tuple[str, ...]] = ()
    state_units: ClassVar[tuple[str, ...]] = ()
    noun: ClassVar[str] = "system"
    start_name: ClassVar[str] = "start"
    motion_signal: ClassVar[str] = ""
    velocity_signal: ClassVar[str] = ""
    renamed: ClassVar[Mapping[str, str]] = {}

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Constants of the system with their nominal values, in the order that expressions take them."""

    @abstractmethod
    def step(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Expression:
        """The state (states,) after a period of `period` [s]; a period of no time changes nothing.

        Args:
            state: state at the period's begin, (states,), SI.
            inputs: held in it, (inputs,), SI.
            parameters: values, (p,), SI.
            period: duration of the period [s].
        """

    def signals(
        self, state: Expression, inputs: Expression, parameters: Expression, period: Expression
    ) -> Mapping[str, Expression]:
        """Further columns of expressions, by name, that measurements and limits may ask for: means over a
        period that begins so, or of an instant where `period` is 0.


        Args:
            state: state at the period's begin, (states,), SI.
            inputs: held, (inputs,), SI.
            parameters: values, (p,), SI.
            period: duration of the period [s]; 0 for the instant.
        """
        return {}

    def issues(self) -> list[Issue]:
        """Why this is no system at all; [] where it is one."""
        return []

    def doubts(self, problem: Any) -> Sequence[Issue]:
        """Return sizes in a problem that hardly mean what they say, if usual ones of such systems are known.

        Args:
            problem: `Problem` of this system, which stands above systems.
        """
        return ()

    def estimating(self, names: Collection[str]) -> System:
        """The system that has the parameters `names`: this one, unless a domain knows it by others too."""
        return self

    @property
    def estimable(self) -> Mapping[str, tuple[str, ...]]:
        """Names of parameters that can be estimated together, by what they are called in messages."""
        return {"parameters": tuple(parameter.name for parameter in self.parameters)}

    def remedy(self, unbounded: Input, limits: Sequence[str]) -> str:
        """Return the remedy for an input that nothing bounds, given the names of the limits there are."""
        return f"add a limit on {unbounded.quantity}"

    def speed_of(self, inputs: npt.ArrayLike) -> float:
        """Return the speed through space [m/s], at rest before, at the nominal parameters."""
        if not self.velocity_signal:
            return 0.0
        signals = self.signals(ca.DM.zeros(len(self.states)), ca.DM(inputs), ca.DM(self.nominal), ca.DM(0))
        return float(ca.norm_2(signals[self.velocity_signal][:2]))

    def lever(self, entry: Input) -> float:
        """The length [m] by which a speed in m/s is one of its inputs in rad/s, nominal; 0 where none is
        known.
        """
        return 0.0

    def allows(self, values: Mapping[str, float]) -> bool:
        """Return whether the system can have these values of parameters, SI."""
        return True

    def long_names(self, name: str) -> tuple[str, ...]:
        """The parameters that a key stands for: its own, unless a domain has keys for several at once."""
        return (name,)

    @property
    def predictions(self) -> Mapping[str, tuple[str, ...]]:
        """States that a user may want predicted, by what they are together: each by itself."""
        return {name: (name,) for name in self.states}

    @property
    def exact(self) -> System:
        """The system that predicts: as it steps with no error of integration, however long the period."""
        return self

    @property
    def integrates(self) -> bool:
        """True if steps are those of a numerical integration, and so as exact as they are short."""
        return False

    def refined(self, times: int) -> System:
        """The system with so many times more steps of its integration in a period.

        Args:
            times: factor, at least 1.
        """
        return self

    @property
    def refinement(self) -> tuple[System, int]:
        """The system that this one refines, and the number of its periods that a period is made of."""
        return self, 1

    @property
    def shown_units(self) -> Mapping[str, Unit]:
        """Units in which parameters are given, and their factors from SI, by name; {} where none are."""
        return {}

    @property
    def when_not_finite(self) -> str:
        """Remedy where states or readings are not finite; "" where nothing is known."""
        return ""

    @property
    def chosen_states(self) -> int:
        """Number of states, from the first on, that a start may choose; the others begin at 0."""
        return len(self.states)

    @property
    def as_far_as_velocity(self) -> bool:
        """True if within a period it goes no farther than its mean velocity says, wherever it turns."""
        return False

    @property
    def nominal(self) -> list[float]:
        """Nominal parameter values, SI."""
        return [parameter.nominal for parameter in self.parameters]

    @property
    def input_names(self) -> tuple[str, ...]:
        """The inputs' names."""
        return tuple(entry.name for entry in self.inputs)


def label_of(system: System) -> str:
    """Return the name of a system in messages: its kind, where it has one."""
    return str(getattr(system, "kind", type(system).__name__))


@lru_cache(maxsize=32)
def stepper(system: System) -> ca.Function:
    """The function (state, inputs, parameters, period [s]) -> next state."""
    coarse, parts = system.refinement
    if parts > 1:
        state, *held, period = _loop_symbols(system)
        return ca.Function(
            "step", [state, *held, period], [_part_states(coarse, parts, state, held, period)[:, -1]]
        )
    arguments = step_symbols(system)
    return ca.Function("step", arguments, [system.step(*arguments)])


@lru_cache(maxsize=32)
def carrier(system: System) -> ca.Function:
    """The function (S, state, inputs, parameters, period) -> S at the next sample, for the derivatives
    S (states, p + states) of the state by the parameters and the start state.
    """
    states, size = len(system.states), len(system.parameters)
    coarse, parts = system.refinement
    if parts > 1:
        begin = ca.MX.sym("S", states, size + states)
        first, *held, period = _loop_symbols(system)
        begins = ca.horzcat(first, _part_states(coarse, parts, first, held, period)[:, :-1])
        along = carrier(coarse).mapaccum(parts)(begin, begins, *held, period / parts)
        return ca.Function("carry", [begin, first, *held, period], [along[:, -(size + states) :]])
    arguments = step_symbols(system)
    state, _, parameters, _ = arguments
    before = ca.SX.sym("S", states, size + states)
    following = stepper(system)(*arguments)
    direct = ca.horzcat(ca.jacobian(following, parameters), ca.SX(states, states))
    after = ca.jacobian(following, state) @ before + direct
    return ca.Function("carry", [before, *arguments], [ca.densify(after)])


@lru_cache(maxsize=32)
def signaller(system: System) -> ca.Function:
    """The function (state, inputs, parameters, period [s]) -> every signal, by name."""
    arguments = step_symbols(system)
    signals = system.signals(*arguments)
    names = ["state", "inputs", "parameters", "period"]
    return ca.Function("signals", arguments, list(signals.values()), names, list(signals))


@lru_cache(maxsize=32)
def mover(system: System) -> ca.Function:
    """The function (state, inputs, parameters) -> the motion at an instant (m,)."""
    system, _ = system.refinement
    *arguments, _ = step_symbols(system)
    return ca.Function("motion", arguments, [_motion(system, *arguments, ca.SX(0))])


@lru_cache(maxsize=32)
def follows_state(system: System) -> bool:
    """Return whether the motion depends on the state, not on the inputs alone."""
    system, _ = system.refinement
    arguments = step_symbols(system)
    return bool(ca.depends_on(_motion(system, *arguments), arguments[0]))


def _part_states(system: System, parts: int, state: ca.MX, held: Sequence[ca.MX], period: ca.MX) -> ca.MX:
    # States (states, parts) at the ends of the parts of a period: a loop, which takes no more memory the
    # more parts there are.
    return stepper(system).mapaccum(parts)(state, *held, period / parts)


def _loop_symbols(system: System) -> list[ca.MX]:
    return [ca.MX.sym("given", *symbol.shape) for symbol in step_symbols(system)]


def _motion(system: System, *given: Expression) -> Expression:
    return system.signals(*given).get(system.motion_signal, ca.SX(0, 1))


def step_symbols(system: System) -> list[ca.SX]:
    """Return symbols for the arguments of a step: state, inputs, parameters and period."""
    return [
        ca.SX.sym("state", len(system.states)),
        ca.SX.sym("inputs", len(system.inputs)),
        ca.SX.sym("p", len(system.parameters)),
        ca.SX.sym("period"),
    ]
