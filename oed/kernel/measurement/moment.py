"""What a sensor may read at one time, and what it reads there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca

from oed.foundation.errors import UserMistake
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Named
from oed.kernel.dynamics.system import System

if TYPE_CHECKING:
    from oed.kernel.measurement.sensor import Sensor


@dataclass(frozen=True)
class Moment(Named):
    """What a sensor may read at one time; expressions.

    Attributes:
        system: that is driven.
        state: (states,).
        inputs: held at that time, (inputs,).
        signals: the system's, at that instant or as means of the period; attributes by their names.
        nuisances: the sensor's own, by the names it gave them.
        earlier: of a sensor that reads between samples, the moment that its reading begins at.
        elapsed: the time since then [s]; 0 of other sensors.
        period: how long a reading of a period lasts [s]; 0 of an instant.
    """

    system: System
    state: Expression
    inputs: Expression
    signals: Mapping[str, Expression]
    nuisances: Mapping[str, Expression]
    earlier: Moment | None = None
    elapsed: Expression | float = 0.0
    period: Expression | float = 0.0


class AnyMoment:
    """A moment at which nothing is known: symbols for all that is asked.

    Attributes:
        SIZE: entries of each, more than any system's state or signal has.
        nuisances: the sensor's own.
    """

    SIZE = 32

    def __init__(self, nuisances: Mapping[str, Expression]) -> None:
        """Keep the nuisances."""
        self.nuisances = nuisances

    @property
    def earlier(self) -> AnyMoment:
        """Another one."""
        return AnyMoment(self.nuisances)

    def __getattr__(self, name: str) -> Expression:
        """A symbol."""
        return ca.SX.sym(name, self.SIZE)


@lru_cache(maxsize=64)
def moment_reading(sensor: Sensor, system: System) -> ca.Function:
    """What a sensor reads at one moment, as a function of (state, S, inputs, parameters, nuisances, period).

    S (states, p + states) are the state's derivatives by parameters and start. Of a reading between two
    moments the states, S and inputs of the later one stand above those of the earlier, and the period is the
    time between them. The results are the reading (q,), its derivatives by parameters, start and nuisances
    (columns, q), its whitening (q, q), sparse, and the first two in units of the noise.
    """
    states, size = len(system.states), len(system.parameters)
    moments = 2 if sensor.when == "between samples" else 1
    state, inputs = ca.SX.sym("state", moments * states), ca.SX.sym("inputs", moments * len(system.inputs))
    parameters, own = ca.SX.sym("p", size), ca.SX.sym("nuisances", len(sensor.nuisances))
    period = ca.SX.sym("period")
    carried = ca.SX.sym("S", moments * states, size + states)
    names = [nuisance.name for nuisance in sensor.nuisances]
    nuisances = dict(zip(names, ca.vertsplit(own), strict=True))
    moment: Moment | None = None
    for place in reversed(range(moments)):
        at, held = (
            one[place * size : (place + 1) * size]
            for one, size in ((state, states), (inputs, len(system.inputs)))
        )
        lasting = period if sensor.when == "in periods" else 0.0
        signals = system.signals(at, held, parameters, lasting)
        moment = Moment(system, at, held, signals, nuisances, moment, period if moment else 0.0, lasting)
    assert moment is not None
    # Sparse: readings of many points are independent of each other.
    reading, whitening = sensor.reading(moment), ca.sparsify(ca.SX(sensor.whitening(moment)))
    if whitening.shape != 2 * (reading.numel(),):
        text = f"expected {2 * (reading.numel(),)}, as its reading has entries, got {whitening.shape}"
        raise UserMistake(f"measurement: the whitening of {sensor.kind}: {text}")
    direct = ca.horzcat(ca.jacobian(reading, parameters), ca.SX(reading.shape[0], states))
    through = ca.jacobian(reading, state) @ carried + direct
    jacobian = ca.densify(ca.horzcat(through, ca.jacobian(reading, own)))
    return ca.Function(
        "reading",
        [state, carried, inputs, parameters, own, period],
        [reading, jacobian.T, whitening, whitening @ reading, (whitening @ jacobian).T],
    )


def reading_by_signal(sensor: Sensor, system: System, name: str) -> ca.Function:
    """The derivatives (n, q) of what a sensor reads at one moment by a signal (n,), as a function of (state,
    inputs, parameters, nuisances, period).

    Args:
        sensor: that reads.
        system: whose signal it is.
        name: of the signal.
    """
    state, inputs = ca.SX.sym("state", len(system.states)), ca.SX.sym("inputs", len(system.inputs))
    parameters, own = ca.SX.sym("p", len(system.parameters)), ca.SX.sym("nuisances", len(sensor.nuisances))
    period = ca.SX.sym("period")
    nuisances = {one.name: own[place] for place, one in enumerate(sensor.nuisances)}
    signals = dict(system.signals(state, inputs, parameters, period))
    more = ca.SX.sym("more", *signals[name].shape)
    signals[name] = signals[name] + more
    reading = sensor.reading(Moment(system, state, inputs, signals, nuisances, None, 0.0))
    slopes = ca.substitute(ca.jacobian(reading, more), more, ca.SX.zeros(*more.shape))
    return ca.Function("by_signal", [state, inputs, parameters, own, period], [ca.densify(slopes).T])
