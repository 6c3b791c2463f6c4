"""Drives under limits: their rows as numbers, their margins, and where the oracle sees them go."""

from __future__ import annotations

import casadi as ca
import numpy as np
import oracle
from builders import input_limits, problem_of
from pydantic import TypeAdapter
from sample_robots import ROBOTS, Example

from oed.kernel.criteria import E
from oed.kernel.dynamics.rollout import Drive, roll_out
from oed.kernel.dynamics.space import Spline
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.kernel.results import Margin
from oed.robots.limits import LIMITS, Limit
from oed.robots.sensors import Poses
from oed.robots.space import DesignSpace

FINER = 10
"""Times per period that limits are looked at."""
DENSE = 200
"""The same where all times are meant."""
DURATION, SAMPLES = 6.0, 24

BY_NAME = {example.name: example for example in ROBOTS}


def limited(example: Example, *limits: Limit, runs: int = 1, **space) -> Problem:
    """The example robot under these limits, with bounds on its inputs where these give none."""
    names = {limit.name for limit in limits}
    bounds = [limit for limit in input_limits(example.model) if limit.name not in names]
    shape = {"duration": DURATION, "samples": SAMPLES, "spline": Spline(coefficients=8), "runs": runs}
    return problem_of(
        model=example.model,
        design=DesignSpace(**{**shape, **space}),
        measurement=Poses(noise={"position": 0.01, "heading": 0.01}),
        limits=(*bounds, *limits),
        criterion=E(scaling="relative"),
    )


def margin_of(problem: Problem, drive: Trajectory, name: str) -> Margin:
    (margin,) = [margin for margin in evaluate(problem, drive).margins if margin.name == name]
    return margin


def fine_times(drive: Trajectory) -> np.ndarray:
    return np.linspace(0, drive.duration, FINER * drive.samples + 1)


def as_drive(model, trajectory: Trajectory) -> Drive:
    """The drive in numbers, every run on the fine grid of the scorer."""
    runs = [(run, fine_times(run)) for run in trajectory.each]
    values = np.concatenate([run.inputs_at(times) for run, times in runs])
    rates = np.concatenate([run.inputs_at(times, 1) for run, times in runs])
    jerks = np.concatenate([run.inputs_at(times, 2) for run, times in runs])
    return roll_out(
        model,
        inputs=ca.DM(trajectory.inputs),
        start=ca.DM(trajectory.starts),
        parameters=ca.DM(model.nominal),
        period=ca.DM(trajectory.period),
        input_values=ca.DM(values),
        input_rates=ca.DM(rates),
        input_jerks=ca.DM(jerks),
        motion_inputs=ca.DM(values),
        refine=FINER,
        runs=trajectory.runs,
    )


def row_values(limit: Limit, drive: Drive) -> np.ndarray:
    return np.array(ca.evalf(limit.rows(drive).expression)).ravel()


def slack(limit: Limit, drive: Drive) -> float:
    """The least distance from any bound."""
    rows, values = limit.rows(drive), row_values(limit, drive)
    return float(min((rows.upper - values).min(), (values - rows.lower).min()))


def dense_times(drive: Trajectory) -> np.ndarray:
    """So many times that little happens between them, knots and both ends included."""
    return np.union1d(np.linspace(0, drive.duration, DENSE * drive.samples + 1), drive.knots)


def fine_twists(example: Example, drive: Trajectory, *, dense: bool = False) -> np.ndarray:
    """Twists (K, 3) that limits look at, by the oracle: of the splines at all times looked at; of a robot
    that lags, those that it has from the begin of each period to its end.
    """
    if not example.on_arcs:
        return _lagging_twists(example, drive)
    times = dense_times(drive) if dense else fine_times(drive)
    return np.array([example.twist(row) for row in oracle.spline_values(drive, times)])


def _lagging_twists(example: Example, drive: Trajectory) -> np.ndarray:
    state, found = np.array(drive.starts[0]), []
    for row in drive.inputs:
        times = np.linspace(0, drive.period, FINER + 1)
        states = [np.array([*state[:3], *example.further(state, row, time)]) for time in times]
        found += [example.moved(state, row, 0.0) for state in states]
        state = states[-1]
    return np.array(found)


def fine_path(example: Example, drive: Trajectory) -> np.ndarray:
    """Poses (K, 3) at all times looked at, by the oracle."""
    middles = (np.arange(drive.samples) + 0.5) * drive.period
    twists = np.array([example.twist(row) for row in oracle.spline_values(drive, middles)])
    return oracle.fine_path(twists, drive.starts[0], drive.period, "arc", FINER)


def limit_of(key: str, value):
    """The limit of a study's key, read as a study is."""
    return TypeAdapter(LIMITS[key]).validate_python(value)
