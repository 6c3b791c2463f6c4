"""Reach of a robot under a problem's limits: its speeds, rates, workspace and path length."""

from __future__ import annotations

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.system import follows_state, stepper
from oed.kernel.dynamics.trajectory import middles
from oed.kernel.problem import Problem
from oed.robots.limits.body_motion import PathLength
from oed.robots.limits.workspace import workspace_of
from oed.robots.models.model import robot_of
from oed.robots.models.skid_steer import SkidSteer


def input_reach(problem: Problem) -> Array:
    """Return the largest magnitude of each input in each period, (N, inputs).

    It is the input's bound, and from rest to rest what the largest rate allows.
    """
    space = problem.design
    largest = np.abs(problem.input_bounds).max(axis=1)
    reach = np.tile(largest, (space.samples, 1))
    if space.rest_to_rest:
        times = middles(space.duration, space.samples)
        spare = np.minimum(times, times[::-1])
        reach = np.minimum(reach, problem.rest_spare + np.outer(spare, largest_rates(problem)))
    return np.asarray(reach)


def largest_rates(problem: Problem) -> Array:
    """Return the largest magnitude of each input's rate, (inputs,); infinite without a limit."""
    return np.asarray(np.abs(problem.rate_bounds).max(axis=1))


def largest_input_gain(problem: Problem) -> float | None:
    """Return an upper bound on the ratio of effective inputs to inputs.

    It is None if the robot states none, or if its motion does not follow from its inputs alone.
    """
    model = robot_of(problem.model)
    if follows_state(model):
        return None
    if isinstance(model, SkidSteer):
        return max(abs(1 - model.slip_outer), abs(1 - model.slip_inner))
    # Without a redefinition the effective inputs are the inputs themselves.
    rng = np.random.default_rng(0)
    inputs = ca.DM(rng.standard_normal(len(model.inputs)))
    effective = model.effective_inputs(inputs, ca.DM(model.nominal))
    return 1.0 if effective is inputs else None


def has_exact_inputs(problem: Problem) -> bool:
    """Return True if the effective inputs equal the inputs."""
    model = robot_of(problem.model)
    if isinstance(model, SkidSteer):
        return model.slip_outer == model.slip_inner == 0
    return largest_input_gain(problem) == 1.0


def coefficient_rows(problem: Problem) -> tuple[Array, Array] | None:
    """Return the rows of c for yaw rate and forward speed at the nominal values.

    They are None for a robot without c, one that also moves sideways, and one whose motion does not
    follow from its inputs alone.
    """
    model = robot_of(problem.model)
    if len(model.coefficient_names) != 2 or follows_state(model):
        return None
    matrix = np.array(ca.evalf(model.coefficients(ca.DM(model.nominal))))
    return matrix[0], matrix[1]


def top_speeds(problem: Problem) -> Array | None:
    """Return the largest speed of the robot's origin in each period, (N,) [m/s]; None if unknown."""
    rows, factor = coefficient_rows(problem), largest_input_gain(problem)
    if rows is None or factor is None:
        return None
    return np.asarray(factor * input_reach(problem) @ np.abs(rows[1]))


def workspace_bounds(problem: Problem) -> tuple[float, float, float, float] | None:
    """Return the rectangle x_min, x_max, y_min, y_max of the robot's origin; None without a workspace."""
    workspace = workspace_of(problem.limits)
    if workspace is None:
        return None
    x_min, x_max, y_min, y_max = workspace.widened_extent(problem.excess)
    if not np.isfinite(x_min):
        return None
    radius = robot_of(problem.model).body_radius
    return x_min + radius, x_max - radius, y_min + radius, y_max - radius


def path_budget(problem: Problem) -> float | None:
    """Return the largest path length of the robot's origin [m]; None without a limit."""
    path_limits = [limit for limit in problem.limits if isinstance(limit, PathLength)]
    return (1 + problem.excess) * path_limits[0].bounds if path_limits else None


def scales_lengths(problem: Problem, names: tuple[str, ...]) -> bool:
    """Return True if growing the parameters `names` by one factor scales the path by that factor.

    Then a step from a scaled position ends at a scaled position, and neither the heading nor any further
    state changes.
    """
    robot = robot_of(problem.system)
    if robot.physical is not robot:
        return False
    rng = np.random.default_rng(0)
    nominal, states = np.array(robot.nominal), len(robot.states)
    grown = np.array([entry.name in names for entry in robot.parameters])
    inputs, state = ca.SX.sym("u", len(robot.inputs)), ca.SX.sym("x", states)
    parameters, period = ca.SX.sym("p", len(nominal)), ca.SX.sym("T")
    following = stepper(robot)(state, inputs, parameters, period)
    direction = ca.vertcat(state[:2], ca.SX(states - 2, 1), ca.DM(np.where(grown, nominal, 0.0)))
    change = ca.jtimes(following, ca.vertcat(state, parameters), direction)
    function = ca.Function("change", [state, inputs, parameters, period], [following, change])
    low, high = problem.input_bounds.T
    for _ in range(20):
        point = rng.uniform(-1, 1, states), rng.uniform(low, high), nominal, rng.uniform(0.5, 2)
        end, end_change = (np.array(result).ravel() for result in function(*point))
        expected = np.concatenate([end[:2], np.zeros(states - 2)])
        if not np.allclose(end_change, expected, rtol=1e-9, atol=1e-12 + 1e-9 * np.abs(end).max()):
            return False
    return True
