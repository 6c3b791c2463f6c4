"""A drive as expressions: what every measurement, limit and criterion is written in terms of.

The same code serves CasADi's SX (unrolled, for the optimiser) and MX (compact, for scoring).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.kernel.dynamics.expression import Expression
from oed.robots.models.model import Integration, Model, chord, follows_state, step

FINE = 10
"""How many times finer than the samples the grid is on which limits are checked."""


@dataclass(frozen=True)
class Drive:
    """One drive of a model as CasADi expressions; rows are times, those of several runs one after the other.

    Attributes:
        model: the robot.
        integration: rule by which its poses follow from its twist.
        parameters: its parameters' values, (p,).
        period: sample period T [s].
        inputs: held in each period, (N, inputs).
        effective_inputs: as they act on the ground, (N, q).
        twist: forward and lateral speed [m/s], yaw rate [rad/s] of the motion in each period, (N, 3).
        gain: displacement per unit of speed in each period [s], (N, 1).
        direction: heading of each period's displacement [rad], (N, 1).
        poses: at the samples, (N + runs, states): each run has a pose more than periods.
        path: poses where position limits apply, (G, states).
        motion: twists where limits on the motion apply, (K, 3): those that the inputs ask for; of a robot
            that follows them with a lag those that it has where each period begins, then where each ends.
        input_values: values that bound the inputs at all times checked, (K, inputs).
        input_rates: values that bound their derivatives, (K', inputs).
        input_jerks: values that bound their second derivatives, (K'', inputs).
        runs: how many runs of equal length the N periods are shared out to.
        refine: points of `path` per sample.
        first_run: place of the first of these runs, where the drive is a part of one of several.
    """

    model: Model
    integration: Integration
    parameters: Expression
    period: Expression
    inputs: Expression
    effective_inputs: Expression
    twist: Expression
    gain: Expression
    direction: Expression
    poses: Expression
    path: Expression
    motion: Expression
    input_values: Expression
    input_rates: Expression
    input_jerks: Expression
    runs: int = 1
    refine: int = 1
    first_run: int = 0

    @property
    def samples(self) -> int:
        """Periods of one run."""
        return int(self.inputs.shape[0]) // self.runs

    @property
    def begins(self) -> list[int]:
        """Rows of `poses` at which periods begin, (N,)."""
        return [run * (self.samples + 1) + k for run in range(self.runs) for k in range(self.samples)]

    def ends_of(self, rows: Expression) -> tuple[Expression, Expression]:
        """First and last rows of every run, (runs, columns) each, of `poses` or `path`."""
        each = rows.shape[0] // self.runs
        first = [run * each for run in range(self.runs)]
        return rows[first, :], rows[[index + each - 1 for index in first], :]

    @cached_property
    def sensitivities(self) -> Expression:
        """Derivatives of the poses at the samples, side by side: (states, (N + runs) * (p + states)).

        For each sample the columns are the parameters, then the start state of its run. They are carried
        along the drive by the chain rule, with exact derivatives of one step.
        """
        count, states = self.samples, len(self.model.states)
        begin = ca.horzcat(ca.DM(states, len(self.model.parameters)), ca.DM.eye(states))
        carry = carrier(self.model, self.integration).mapaccum(count)
        parameters, periods = ca.repmat(self.parameters, 1, count), ca.repmat(self.period, 1, count)
        poses, inputs = self.poses[self.begins, :].T, self.inputs.T
        parts = []
        for run in range(self.runs):
            own = slice(run * count, (run + 1) * count)
            parts += [begin, carry(begin, poses[:, own], inputs[:, own], parameters, periods)]
        return ca.horzcat(*parts)

    @cached_property
    def path_sensitivities(self) -> Expression:
        """The same derivatives at every point of `path`: (states, G * (p + states))."""
        if self.refine == 1:
            return self.sensitivities
        count, between = self.samples, self.refine - 1
        width = len(self.model.parameters) + len(self.model.states)
        carry = carrier(self.model, self.integration).map(count * between)
        fractions = ca.DM(np.tile(np.arange(1, self.refine) / self.refine, count)).T
        columns = np.repeat(np.arange(count), between).tolist()
        repeated = ca.repmat(self.parameters, 1, count * between)
        parts = []
        for run in range(self.runs):
            first = run * (count + 1)
            known = self.sensitivities[:, first * width : (first + count + 1) * width]
            poses = self.poses[first : first + count, :].T
            held = self.inputs[run * count : (run + 1) * count, :].T
            wide = (np.array(columns)[:, None] * width + np.arange(width)).ravel().tolist()
            inner = carry(
                known[:, wide], poses[:, columns], held[:, columns], repeated, self.period * fractions
            )
            order = _interleaved(count, self.refine)
            wide = (order[:, None] * width + np.arange(width)).ravel().tolist()
            parts.append(ca.horzcat(known, inner)[:, wide])
        return ca.horzcat(*parts)

    def again(self, parameters: Expression, start: Expression, model: Model | None = None) -> Drive:
        """The drive that the same inputs give a robot with other parameters (p,) from other starts
        (runs, states), or another model of it.
        """
        return roll_out(
            model or self.model,
            self.integration,
            inputs=self.inputs,
            start=start,
            parameters=parameters,
            period=self.period,
            refine=self.refine,
            runs=self.runs,
        )

    def path_length(self, softening: float = 1e-9) -> Expression:
        """Distance travelled by the robot's origin [m].

        `softening` [m/s] rounds the speed's corner at rest, for optimisers that need finite curvature.
        """
        speed = ca.sqrt(self.twist[:, 0] ** 2 + self.twist[:, 1] ** 2 + softening**2)
        return ca.sum1(speed - softening) * self.period


@dataclass(frozen=True)
class DriveShape(Drive):
    """A drive of symbols that nothing is said of: its shape alone, which costs little however long it is."""

    @cached_property
    def sensitivities(self) -> Expression:
        """Symbols."""
        states = len(self.model.states)
        count = (self.samples + 1) * self.runs
        return ca.MX.sym("sensitivities", states, count * (len(self.model.parameters) + states))


def drive_shape(
    model: Model, integration: Integration, *, samples: int, runs: int, period: float
) -> DriveShape:
    """The shape of a robot's drives of so many samples in each run, at its nominal parameters."""
    count, states = samples * runs, len(model.states)
    inputs, twist = ca.MX.sym("inputs", count, len(model.inputs)), ca.MX.sym("twist", count, 3)
    poses = ca.MX.sym("poses", count + runs, states)
    columns = _sample(model, integration).size1_out(1)
    return DriveShape(
        model=model,
        integration=integration,
        parameters=ca.MX(ca.DM(model.nominal)),
        period=ca.MX(period),
        inputs=inputs,
        effective_inputs=ca.MX.sym("effective_inputs", count, columns),
        twist=twist,
        gain=ca.MX.sym("gain", count),
        direction=ca.MX.sym("direction", count),
        poses=poses,
        path=poses,
        motion=ca.repmat(twist, 2 if follows_state(model) else 1, 1),
        input_values=inputs,
        input_rates=inputs,
        input_jerks=inputs,
        runs=runs,
    )


@lru_cache(maxsize=32)
def _sample(model: Model, integration: Integration) -> ca.Function:
    # Everything a measurement may need of one period, as one function to map over the periods.
    pose, period = ca.SX.sym("pose", len(model.states)), ca.SX.sym("period")
    inputs, parameters = ca.SX.sym("inputs", len(model.inputs)), ca.SX.sym("p", len(model.parameters))
    twist = model.mean_twist(pose, model.twist(inputs, parameters), parameters, period)
    gain, direction = chord(twist[2], pose[2], period, integration)
    effective = model.effective_inputs(inputs, parameters)
    return ca.Function("sample", [pose, inputs, parameters, period], [twist, effective, gain, direction])


@lru_cache(maxsize=32)
def carrier(model: Model, integration: Integration) -> ca.Function:
    """The function (S, pose, inputs, parameters, period) -> S at the next sample, for the derivatives
    S (states, p + states) of the pose by the parameters and the start state.
    """
    states, size = len(model.states), len(model.parameters)
    pose, inputs = ca.SX.sym("pose", states), ca.SX.sym("inputs", len(model.inputs))
    parameters, period = ca.SX.sym("p", size), ca.SX.sym("period")
    before = ca.SX.sym("S", states, size + states)
    following = step(model, integration)(pose, inputs, parameters, period)
    direct = ca.horzcat(ca.jacobian(following, parameters), ca.SX(states, states))
    after = ca.jacobian(following, pose) @ before + direct
    return ca.Function("carry", [before, pose, inputs, parameters, period], [ca.densify(after)])


@lru_cache(maxsize=32)
def _twist(model: Model) -> ca.Function:
    inputs, parameters = ca.SX.sym("inputs", len(model.inputs)), ca.SX.sym("p", len(model.parameters))
    return ca.Function("twist", [inputs, parameters], [model.twist(inputs, parameters)])


def roll_out(
    model: Model,
    integration: Integration,
    *,
    inputs: Expression,
    start: Expression,
    parameters: Expression,
    period: Expression,
    input_values: Expression | None = None,
    input_rates: Expression | None = None,
    input_jerks: Expression | None = None,
    motion_inputs: Expression | None = None,
    refine: int = 1,
    runs: int = 1,
) -> Drive:
    """The drive that holds `inputs` (N, inputs) from `start` (runs, states).

    Args:
        model: the robot.
        integration: rule by which its poses follow from its twist.
        inputs: one row per period, of all runs.
        start: of every run; of a single one also (states,).
        parameters: (p,).
        period: sample period T [s].
        input_values: what bounds the inputs at all times checked; the inputs themselves by default.
        input_rates: what bounds their derivatives.
        input_jerks: what bounds their second derivatives.
        motion_inputs: inputs whose twists limits on the motion apply to; by default those held. A robot that
            follows them with a lag moves by those held, whatever is asked for between.
        refine: path points per sample.
        runs: how many runs of equal length the periods are shared out to.
    """
    each = inputs.shape[0] // runs
    repeated, periods = ca.repmat(parameters, 1, each), ca.repmat(period, 1, each)
    begin = start.T if runs > 1 else ca.reshape(start, -1, 1)
    accumulate = step(model, integration).mapaccum(each)
    following = [
        accumulate(begin[:, run], inputs[run * each : (run + 1) * each, :].T, repeated, periods)
        for run in range(runs)
    ]
    return drive_through(
        model,
        integration,
        inputs=inputs,
        poses=[ca.horzcat(begin[:, run], part) for run, part in enumerate(following)],
        parameters=parameters,
        period=period,
        input_values=input_values,
        input_rates=input_rates,
        input_jerks=input_jerks,
        motion_inputs=motion_inputs,
        refine=refine,
    )


def drive_through(
    model: Model,
    integration: Integration,
    *,
    inputs: Expression,
    poses: list[Expression],
    parameters: Expression,
    period: Expression,
    input_values: Expression | None = None,
    input_rates: Expression | None = None,
    input_jerks: Expression | None = None,
    motion_inputs: Expression | None = None,
    refine: int = 1,
) -> Drive:
    """The drive that holds `inputs` (N, inputs), given its poses at the samples.

    Args:
        model: the robot.
        integration: rule by which its poses follow from its twist.
        inputs: one row per period, of all runs.
        poses: of every run, (states, N / runs + 1); that the inputs lead from one to the next is the caller's
            affair.
        parameters: (p,).
        period: sample period T [s].
        input_values: as in `roll_out`, like all that follows.
        input_rates: what bounds their derivatives.
        input_jerks: what bounds their second derivatives.
        motion_inputs: inputs whose twists limits on the motion apply to.
        refine: path points per sample.
    """
    count, runs = inputs.shape[0], len(poses)
    each = count // runs
    held, repeated = inputs.T, ca.repmat(parameters, 1, count)
    periods = ca.repmat(period, 1, count)
    advance = step(model, integration)
    slices = [slice(run * each, (run + 1) * each) for run in range(runs)]
    begun = ca.horzcat(*(part[:, :each] for part in poses))
    twist, effective, gain, direction = _sample(model, integration).map(count)(begun, held, repeated, periods)
    if follows_state(model):
        motion = _actual_motion(model, poses, held, parameters)
    else:
        motion = twist.T if motion_inputs is None else asked_motion(model, motion_inputs, parameters)
    path = [
        _refined_path(advance, part, held[:, own], parameters, period, refine)
        for part, own in zip(poses, slices, strict=True)
    ]
    return Drive(
        model=model,
        integration=integration,
        parameters=parameters,
        period=period,
        inputs=inputs,
        effective_inputs=effective.T,
        twist=twist.T,
        gain=gain.T,
        direction=direction.T,
        poses=ca.horzcat(*poses).T,
        path=ca.horzcat(*path).T,
        motion=motion,
        input_values=inputs if input_values is None else input_values,
        input_rates=inputs if input_rates is None else input_rates,
        input_jerks=inputs if input_jerks is None else input_jerks,
        runs=runs,
        refine=refine,
    )


def asked_motion(model: Model, inputs: Expression, parameters: Expression) -> Expression:
    """The twists (K, 3) that inputs (K, inputs) ask for, whether or not the robot follows them at once."""
    count = inputs.shape[0]
    return _twist(model).map(count)(inputs.T, ca.repmat(parameters, 1, count)).T


def _actual_motion(
    model: Model, poses: list[Expression], held: Expression, parameters: Expression
) -> Expression:
    # The twists where periods begin, then those where they end, (2 N, 3): the inputs jump in between.
    count = held.shape[1]
    begins = ca.horzcat(*(part[:, :-1] for part in poses))
    ends = ca.horzcat(*(part[:, 1:] for part in poses))
    states, twice = ca.horzcat(begins, ends), ca.horzcat(held, held)
    return _instant(model).map(2 * count)(states, twice, ca.repmat(parameters, 1, 2 * count)).T


@lru_cache(maxsize=32)
def _instant(model: Model) -> ca.Function:
    # The twist that a robot has in a state with inputs.
    state = ca.SX.sym("state", len(model.states))
    inputs, parameters = ca.SX.sym("inputs", len(model.inputs)), ca.SX.sym("p", len(model.parameters))
    twist = model.mean_twist(state, model.twist(inputs, parameters), parameters, ca.SX(0))
    return ca.Function("instant", [state, inputs, parameters], [twist])


@dataclass(frozen=True)
class Moment(Drive):
    """One instant of a drive, some way through a period: `path` and `motion` are a single row.

    Attributes:
        begin_sensitivities: those of the state at the period's begin, (states, p + states); None where
            nobody asks for them.
    """

    begin_sensitivities: Expression | None = None

    @cached_property
    def path_sensitivities(self) -> Expression:
        """Derivatives of the point by the parameters and the start state of its run: (states, p + states)."""
        carry = carrier(self.model, self.integration)
        state, inputs = self.poses[0, :].T, self.inputs.T
        return carry(self.begin_sensitivities, state, inputs, self.parameters, self.period)


def moment(
    model: Model,
    integration: Integration,
    *,
    state: Expression,
    inputs: Expression,
    asked: Expression,
    parameters: Expression,
    elapsed: Expression,
    begin_sensitivities: Expression | None = None,
    run: int = 0,
) -> Moment:
    """The instant `elapsed` [s] after a period began in `state` (states,), of a drive's run.

    Args:
        model: the robot.
        integration: rule by which its poses follow from its twist.
        state: at the period's begin.
        inputs: held in the period, (inputs,).
        asked: values of the splines at the instant, (inputs,).
        parameters: (p,).
        elapsed: [s], at most a period.
        begin_sensitivities: of the state, (states, p + states).
        run: which one.
    """
    drive = roll_out(
        model,
        integration,
        inputs=inputs.T,
        start=state,
        parameters=parameters,
        period=elapsed,
        input_values=asked.T,
        motion_inputs=asked.T,
    )
    parts = {entry.name: getattr(drive, entry.name) for entry in fields(drive)}
    parts |= {"path": drive.path[-1, :], "motion": drive.motion[-1, :], "first_run": run}
    return Moment(**parts, begin_sensitivities=begin_sensitivities)


def _refined_path(
    advance: ca.Function,
    poses: Expression,
    held: Expression,
    parameters: Expression,
    period: Expression,
    refine: int,
) -> Expression:
    if refine == 1:
        return poses
    # The poses at the samples are known; between them, refine - 1 steps of a fraction of the period.
    count, between = held.shape[1], refine - 1
    columns = np.repeat(np.arange(count), between).tolist()
    fractions = ca.DM(np.tile(np.arange(1, refine) / refine, count)).T
    repeated = ca.repmat(parameters, 1, count * between)
    inner = advance.map(count * between)(poses[:, columns], held[:, columns], repeated, period * fractions)
    return ca.horzcat(poses, inner)[:, _interleaved(count, refine).tolist()]


def _interleaved(count: int, refine: int) -> npt.NDArray[np.int_]:
    # Where the points of the fine grid stand behind each other among the samples, then those between.
    order = np.empty(count * refine + 1, dtype=int)
    order[::refine] = np.arange(count + 1)
    order[np.arange(len(order)) % refine > 0] = count + 1 + np.arange(count * (refine - 1))
    return order
