"""A drive as expressions: what every measurement, limit and criterion is written in terms of.

The same code serves CasADi's SX (unrolled, for the optimiser) and MX (compact, for scoring).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from oed.foundation.arrays import block_columns
from oed.foundation.presenting import Brief
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.system import System, carrier, follows_state, mover, signaller, stepper

FINE = 10
"""Factor by which the grid on which limits are checked is finer than the samples."""


class Named:
    """Values with the signals of a `system` as attributes, under a domain's own names for its parts."""

    system: System
    signals: Mapping[str, Expression]

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """A signal, or the part that the system's domain calls so.

            Raises:
                AttributeError: there is neither; with the names there are.
            """
            if name.startswith("_") or name in ("system", "signals"):
                raise AttributeError(name)
            if hasattr(type(self), name):
                # A property whose code raised AttributeError: its error is the one to show.
                return object.__getattribute__(self, name)
            if name in self.signals:
                return self.signals[name]
            if name in self.system.renamed:
                return getattr(self, self.system.renamed[name])
            names = ", ".join([*self.signals, *self.system.renamed]) or "none"
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}; its signals are {names}")


@dataclass(frozen=True, repr=False)
class Drive(Brief, Named):
    """One drive of a system as CasADi expressions; rows are times, those of several runs one after the other.

    Attributes:
        system: system that is driven.
        parameters: values of the system's parameters, (p,).
        period: sample period T [s].
        inputs: held in each period, (N, inputs).
        signals: the system's, in each period, (N, ...) each; attributes of the drive by their names.
        states: states at the samples, (N + runs, states): each run has a state more than periods.
        path: states where limits on them apply, (G, states).
        motion: values of the system's signal of motion where limits on it apply, (K, m): those that the
            inputs ask for; of a system that follows them with a lag those that it has where each period
            begins, then where each ends, then at the points of `path` between.
        input_values: values that bound the inputs at all times checked, (K, inputs).
        input_rates: values that bound their derivatives, (K', inputs).
        input_jerks: values that bound their second derivatives, (K'', inputs).
        runs: number of runs of equal length among which the N periods are divided.
        refine: points of `path` per sample.
        first_run: place of the first of these runs, where the drive is a part of one of several.
        repetitions: number of times that each period is carried out, (N,); None for once.
    """

    system: System
    parameters: Expression
    period: Expression
    inputs: Expression
    signals: Mapping[str, Expression]
    states: Expression
    path: Expression
    motion: Expression
    input_values: Expression
    input_rates: Expression
    input_jerks: Expression
    runs: int = 1
    refine: int = 1
    first_run: int = 0
    repetitions: Expression | None = None

    @property
    def samples(self) -> int:
        """Periods of one run."""
        return int(self.inputs.shape[0]) // self.runs

    @property
    def begins(self) -> list[int]:
        """Rows of `states` at which periods begin, (N,)."""
        return [run * (self.samples + 1) + k for run in range(self.runs) for k in range(self.samples)]

    def ends_of(self, rows: Expression) -> tuple[Expression, Expression]:
        """First and last rows of every run, (runs, columns) each, of `states` or `path`."""
        count = rows.shape[0] // self.runs
        first = [run * count for run in range(self.runs)]
        return rows[first, :], rows[[index + count - 1 for index in first], :]

    @property
    def columns(self) -> int:
        """Columns of the sensitivities of one state: the parameters, then the start state."""
        return len(self.system.parameters) + len(self.system.states)

    @cached_property
    def sensitivities(self) -> Expression:
        """Derivatives of the states at the samples, side by side: (states, (N + runs) * (p + states)).

        For each sample the columns are the parameters, then the start state of its run. They are carried
        along the drive by the chain rule, with exact derivatives of one step.
        """
        count, states = self.samples, len(self.system.states)
        begin = ca.horzcat(ca.DM(states, len(self.system.parameters)), ca.DM.eye(states))
        carry = carrier(self.system).mapaccum(count)
        begun, inputs = self.states[self.begins, :].T, self.inputs.T
        parts = []
        for run in range(self.runs):
            places = slice(run * count, (run + 1) * count)
            parts += [begin, carry(begin, begun[:, places], inputs[:, places], self.parameters, self.period)]
        return ca.horzcat(*parts)

    @cached_property
    def path_sensitivities(self) -> Expression:
        """Derivatives of every point of `path`, as `sensitivities` has those of samples:
        (states, G * (p + states)).
        """
        begins = [self.sensitivities[:, block_columns(np.array(self.begins), self.columns)]]
        begins += [self.states[self.begins, :].T, self.inputs.T]
        return _refined(self.sensitivities, carrier(self.system), begins, self)

    def again(self, parameters: Expression, start: Expression, system: System | None = None) -> Drive:
        """The drive that the same inputs give a system with other parameters (p,) from other starts
        (runs, states), or the same seen through others.

        Args:
            parameters: parameters of the other system, (p,).
            start: start states of the other system, (runs, states).
            system: the other system; the same by default.
        """
        return roll_out(
            system or self.system,
            inputs=self.inputs,
            start=start,
            parameters=parameters,
            period=self.period,
            refine=self.refine,
            runs=self.runs,
        )

    @property
    def speeds(self) -> Expression:
        """Speed of the system through space in each period [m/s], (N, 1); 0 of one that does not move."""
        if not self.system.velocity_signal:
            return 0 * ca.sum2(self.inputs)
        velocity = self.signals[self.system.velocity_signal]
        return ca.hypot(velocity[:, 0], velocity[:, 1])

    def path_length(self, softening: float = 1e-9) -> Expression:
        """Distance travelled through space [m]; 0 of a system that has no velocity.

        `softening` [m/s] rounds the speed's corner at rest, for optimisers that need finite curvature.
        """
        if not self.system.velocity_signal:
            return 0 * self.period
        velocity = self.signals[self.system.velocity_signal]
        speed = ca.sqrt(velocity[:, 0] ** 2 + velocity[:, 1] ** 2 + softening**2)
        return ca.sum1(speed - softening) * self.period


@dataclass(frozen=True)
class DriveShape(Drive):
    """A drive of symbols that nothing is said of: its shape alone, which costs little however long it is."""

    @cached_property
    def sensitivities(self) -> Expression:
        """Symbols."""
        count = (self.samples + 1) * self.runs
        return ca.MX.sym("sensitivities", len(self.system.states), count * self.columns)


def drive_shape(system: System, *, samples: int, runs: int, period: float) -> DriveShape:
    """The shape of a system's drives of so many samples in each run, at its nominal parameters.

    Args:
        system: system that is driven.
        samples: number of samples of each run.
        runs: number of runs.
        period: sample period T [s].
    """
    drive = roll_out(
        system,
        inputs=ca.MX.sym("inputs", samples * runs, len(system.inputs)),
        parameters=ca.MX(ca.DM(system.nominal)),
        period=ca.MX(period),
        states=[ca.MX.sym("states", len(system.states), samples + 1) for _ in range(runs)],
        runs=runs,
    )
    return DriveShape(**vars(drive))


def roll_out(
    system: System,
    *,
    inputs: Expression,
    parameters: Expression,
    period: Expression,
    start: Expression | None = None,
    states: Sequence[Expression] | None = None,
    input_values: Expression | None = None,
    input_rates: Expression | None = None,
    input_jerks: Expression | None = None,
    motion_inputs: Expression | None = None,
    refine: int = 1,
    runs: int = 1,
) -> Drive:
    """The drive that holds `inputs` (N, inputs) from `start` (runs, states), or through known `states`.

    Args:
        system: system that is driven.
        inputs: one row per period, of all runs.
        parameters: (p,).
        period: sample period T [s].
        start: start state of every run; of a single one also (states,).
        states: instead, those at the samples, of every run (states, N / runs + 1); that the inputs lead from
            one to the next is the caller's affair.
        input_values: bounds of the inputs at all times checked; the inputs themselves by default.
        input_rates: bounds of the inputs' derivatives.
        input_jerks: bounds of the inputs' second derivatives.
        motion_inputs: inputs whose motion limits apply to; by default those held. A system that follows them
            with a lag moves by those held, whatever is asked for between.
        refine: path points per sample.
        runs: number of runs of equal length among which the periods are divided.
    """
    count, held = inputs.shape[0], inputs.T
    if states is None:
        assert start is not None, "either a start or the states"
        states = _stepped(system, start.T if runs > 1 else ca.reshape(start, -1, 1), held, parameters, period)
    begun = ca.horzcat(*(part[:, :-1] for part in states))
    function = signaller(system)
    results = function.map(count).call([begun, held, parameters, period]) if function.n_out() else []
    signals = {name: result.T for name, result in zip(function.name_out(), results, strict=True)}
    if motion_inputs is None:
        motion = signals.get(system.motion_signal, inputs[:, []])
    else:
        motion = _motion(system, ca.DM.zeros(len(system.states)), motion_inputs.T, parameters)
    drive = Drive(
        system=system,
        parameters=parameters,
        period=period,
        inputs=inputs,
        signals=signals,
        states=ca.horzcat(*states).T,
        path=ca.horzcat(*states).T,
        motion=motion,
        input_values=inputs if input_values is None else input_values,
        input_rates=inputs if input_rates is None else input_rates,
        input_jerks=inputs if input_jerks is None else input_jerks,
        runs=runs,
        refine=refine,
    )
    drive = replace(drive, path=_refined(drive.states.T, stepper(system), [begun, held], drive).T)
    return replace(drive, motion=_followed(drive)) if follows_state(system) else drive


def any_drive(
    system: System, samples: int, runs: int, **further: Any
) -> tuple[tuple[ca.MX, ca.MX, ca.MX, ca.MX], Drive]:
    """Symbols for inputs (N, inputs), start states (runs, states), parameters (p,) and sample period of a
    system, and the drive of these.

    Args:
        system: system that is driven.
        samples: N, of all runs.
        runs: number of runs.
        further: further arguments of `roll_out`.
    """
    symbols = (
        ca.MX.sym("inputs", samples, len(system.inputs)),
        ca.MX.sym("start", runs, len(system.states)),
        ca.MX.sym("parameters", len(system.parameters)),
        ca.MX.sym("period"),
    )
    named = dict(zip(("inputs", "start", "parameters", "period"), symbols, strict=True))
    return symbols, roll_out(system, **named, runs=runs, **further)


def _stepped(
    system: System, starts: Expression, held: Expression, parameters: Expression, period: Expression
) -> list[Expression]:
    # States of every run from its start, a column of `starts`, through its share of the inputs held.
    periods = held.shape[1] // starts.shape[1]
    step = stepper(system).mapaccum(periods)
    pairs = zip(ca.horzsplit(starts), ca.horzsplit(held, periods), strict=True)
    return [ca.horzcat(first, step(first, inputs, parameters, period)) for first, inputs in pairs]


def _motion(system: System, states: Expression, inputs: Expression, parameters: Expression) -> Expression:
    # That (K, m) which inputs (inputs, K) make in states.
    return mover(system).map(inputs.shape[1])(states, inputs, parameters).T


def _followed(drive: Drive) -> Expression:
    # The motion of a system that follows its inputs with a lag: where periods begin, then where they end,
    # for the inputs jump there, then at the points between.
    periods, refine = np.arange(drive.inputs.shape[0]), drive.refine
    # Each run has a point more than its periods have.
    begins = refine * periods + periods // drive.samples
    rows = [begins + point for point in (0, refine, *range(1, refine))]
    states = drive.path[np.concatenate(rows).tolist(), :].T
    return _motion(drive.system, states, ca.repmat(drive.inputs.T, 1, len(rows)), drive.parameters)


@dataclass(frozen=True)
class Instant(Drive):
    """One instant of a drive, some way through a period: `path` and `motion` are a single row.

    Attributes:
        begin_sensitivities: sensitivities of the state at the period's begin, (states, p + states); None if
            nobody asks for them.
    """

    begin_sensitivities: Expression | None = None

    @cached_property
    def path_sensitivities(self) -> Expression:
        """Derivatives of the point by the parameters and the start state of its run: (states, p + states)."""
        carry = carrier(self.system)
        state, inputs = self.states[0, :].T, self.inputs.T
        return carry(self.begin_sensitivities, state, inputs, self.parameters, self.period)


def instant_of(
    system: System,
    *,
    state: Expression,
    held: Expression,
    parameters: Expression,
    period: Expression,
    asked: Expression,
    fraction: Expression,
    sensitivities: Expression | None = None,
    run: int = 0,
) -> Instant:
    """The instant at a fraction of a period.

    Args:
        system: system that is driven.
        state: state at the period's begin, (states,).
        held: inputs in it, (inputs,).
        parameters: parameters of the system, (p,).
        period: sample period T [s].
        asked: values of the inputs' splines at the instant, (inputs,).
        fraction: fraction of the period that has passed.
        sensitivities: sensitivities of the state at its begin, (states, p + states), if they are needed.
        run: place of the instant's run.
    """
    drive = roll_out(
        system,
        inputs=held.T,
        start=state,
        parameters=parameters,
        period=fraction * period,
        input_values=asked.T,
        motion_inputs=asked.T,
    )
    # The drive from the period's begin ends at the instant.
    last = {"path": drive.path[-1, :], "motion": drive.motion[-1, :], "first_run": run}
    return Instant(**vars(drive) | last, begin_sensitivities=sensitivities)


def _refined(table: Expression, step: ca.Function, begins: Sequence[Expression], drive: Drive) -> Expression:
    # A table's columns at the samples, and between them what a step of a fraction of each period leads to,
    # from what is known where the periods begin.
    if drive.refine == 1:
        return table
    if not table.shape[0]:
        # A system without states has no path; thousands of settings would be stepped through for nothing.
        return type(table)(0, drive.runs * (drive.samples * drive.refine + 1))
    count, between = drive.inputs.shape[0], drive.refine - 1
    places = np.repeat(np.arange(count), between)
    fractions = ca.DM(np.tile(np.arange(1, drive.refine) / drive.refine, count)).T
    arguments = [begin[:, block_columns(places, begin.shape[1] // count)] for begin in begins]
    results = step.map(count * between)(*arguments, drive.parameters, drive.period * fractions)
    # The columns as they follow each other in time.
    samples, behind = count + drive.runs, count + drive.runs + np.arange(count * between)
    order = np.empty((drive.runs, drive.samples * drive.refine + 1), dtype=int)
    order[:, :: drive.refine] = np.arange(samples).reshape(drive.runs, -1)
    order[:, np.arange(order.shape[1]) % drive.refine > 0] = behind.reshape(drive.runs, -1)
    return ca.horzcat(table, results)[:, block_columns(order.ravel(), table.shape[1] // samples)]
