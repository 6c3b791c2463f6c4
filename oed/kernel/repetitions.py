"""Repetitions of trials: weights say how often a trial is carried out, and what it costs counts as often."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array, Bools, Places
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive, any_drive
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.parts import Cost, Parts, taken_of
from oed.kernel.problem import Problem

EFFORT = "effort_"
"""Prefix of the inputs of a search that are roots of weights; the number of their sensor follows."""


def repetitions_of(drive: Drive) -> Expression:
    """Return how often each period of a drive is carried out, (N,)."""
    if drive.repetitions is not None:
        return drive.repetitions
    efforts = [place for place, name in enumerate(drive.system.input_names) if name.startswith(EFFORT)]
    if efforts and not drive.system.states:
        return drive.inputs[:, efforts[0]] ** 2
    return ca.DM.ones(drive.inputs.shape[0])


def repetitions(problem: Problem, trajectory: Trajectory) -> Array:
    """Return how often the weights of a trajectory let each of its periods be carried out, (N,).

    A setting of a system without states is carried out as often as its readings count. Other trials are
    carried out once, or as often as they count where weights are of whole trials.
    """
    counts, weights = np.ones(trajectory.samples), trajectory.weights
    if weights is None or (problem.model.states and not _weighs_trials(problem)):
        return counts
    counts[:] = 0.0
    np.maximum.at(counts, _periods(problem, trajectory), weights)
    if _weighs_trials(problem):
        by_trial = counts.reshape(trajectory.runs, -1)
        by_trial[:] = by_trial.max(axis=1, keepdims=True)
    return counts


def carried_out(problem: Problem, trajectory: Trajectory) -> Trajectory:
    """Return a trajectory with each candidate of no weight replaced by one that is carried out.

    Limits are those of candidates that are carried out; of other trajectories nothing changes.
    """
    counts = repetitions(problem, trajectory)
    alone = problem.design.only is not None and trajectory.degree == 0
    if not alone or not counts.any() or counts.all():
        return trajectory
    return with_candidates(trajectory, counts > 0)


def with_candidates(trajectory: Trajectory, chosen: Bools) -> Trajectory:
    """Return a trajectory whose candidates are some of its own, the first of them in place of all others.

    Args:
        trajectory: candidates, inputs held in each period.
        chosen: periods of the candidates that stay; any period of a trial is enough, (N,).
    """
    periods = np.arange(trajectory.samples).reshape(trajectory.runs, -1)
    runs = np.arange(trajectory.runs)
    if trajectory.starts.shape[1]:
        stays = chosen.reshape(trajectory.runs, -1).any(axis=1)
        runs = np.where(stays, runs, np.flatnonzero(stays)[0])
        periods = periods[runs]
    else:
        periods = np.where(chosen, periods.ravel(), np.flatnonzero(chosen)[0])
    table = trajectory.coefficients[periods.ravel()]
    return replace(trajectory, coefficients=table, start=trajectory.starts[runs])


def periods_of(problem: Problem, trajectory: Trajectory, parts: Parts) -> list[Places]:
    """Return the periods among all in which the readings of each part are taken.

    Args:
        problem: problem with the sensors.
        trajectory: trajectory with the readings.
        parts: readings, or groups of them.
    """
    places = _periods(problem, trajectory)
    return [places[list(members)] for members in parts.members]


def costs_of(problem: Problem, trajectory: Trajectory, parts: Parts) -> tuple[Cost, ...]:
    """Return what the limits on all trials together let weights cost.

    Args:
        problem: problem with the limits.
        trajectory: trajectory with the weighted readings.
        parts: readings, or groups of them, with one weight each.
    """
    limits = [limit for limit in problem.limits if limit.counts_trials]
    if not limits or (problem.model.states and not _weighs_trials(problem)):
        return ()
    symbols, drive = any_drive(problem.system, trajectory.samples, trajectory.runs)
    counts = ca.MX.sym("counts", trajectory.samples)
    rows = [limit.rows(replace(drive, repetitions=counts)) for limit in limits]
    slopes = ca.Function("costs", symbols, [ca.jacobian(row.expression, counts) for row in rows])
    arguments = trajectory.inputs, trajectory.starts, problem.system.nominal, trajectory.period
    values = [np.array(value).ravel() for value in slopes.call(list(arguments))]
    return tuple(
        Cost(tuple(_by_part(problem, trajectory, parts, costs).tolist()), float(row.upper[0]))
        for row, costs in zip(rows, values, strict=True)
    )


def _by_part(problem: Problem, trajectory: Trajectory, parts: Parts, costs: Array) -> Array:
    # Cost of each part at a weight of 1, from the costs (N,) of all periods.
    if _weighs_trials(problem):
        runs = [reading.run for reading in parts.readings]
        return np.asarray(costs.reshape(trajectory.runs, -1).sum(axis=1)[runs])
    by_reading = costs[_periods(problem, trajectory)]
    return np.array([by_reading[list(members)].sum() for members in parts.members])


def _periods(problem: Problem, trajectory: Trajectory) -> Places:
    # The period among all in which each reading is taken.
    samples = trajectory.samples // trajectory.runs
    readings = taken_of(problem.sensors, problem.system, trajectory).readings
    places = np.array([reading.time for reading in readings]) / trajectory.period
    runs = np.array([reading.run for reading in readings], dtype=int)
    return np.asarray(runs * samples + np.minimum(places + SLIGHT, samples - 1).astype(int))


def _weighs_trials(problem: Problem) -> bool:
    return problem.selection is not None and problem.selection.of == "trials"


SLIGHT = 1e-6
"""Share of a period that is rounding."""


def spent_at_most(costs: Sequence[Cost], weights: Array) -> Array:
    """Return weights lowered by one share until they keep to all costs.

    Args:
        costs: costs that limit the weights.
        weights: weights of the readings, (n,).
    """
    spent = [(cost.spent(weights), cost.most) for cost in costs]
    share = min((most / amount for amount, most in spent if amount > most > 0), default=1.0)
    return share * weights
