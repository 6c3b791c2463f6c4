"""How fast a robot can be under a problem's limits: what every bound starts from."""

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
    """Largest magnitude of each input in each period, (N, inputs): its bound, and what the largest rate
    allows from rest to rest.
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
    """Largest magnitude of each input's rate, (inputs,); infinite where nothing limits it."""
    return np.asarray(np.abs(problem.rate_bounds).max(axis=1))


def grip(problem: Problem) -> float | None:
    """A factor that no effective input exceeds its input by; None where the robot gives none, and where its
    motion does not follow from its inputs alone.
    """
    model = robot_of(problem.model)
    if follows_state(model):
        return None
    if isinstance(model, SkidSteer):
        return max(abs(1 - model.slip_outer), abs(1 - model.slip_inner))
    # Robots that do not redefine them act with their inputs themselves.
    rng = np.random.default_rng(0)
    inputs = ca.DM(rng.standard_normal(len(model.inputs)))
    effective = model.effective_inputs(inputs, ca.DM(model.nominal))
    return 1.0 if effective is inputs else None


def unslipped(problem: Problem) -> bool:
    """Whether the inputs act on the ground exactly as they are."""
    model = robot_of(problem.model)
    if isinstance(model, SkidSteer):
        return model.slip_outer == model.slip_inner == 0
    return grip(problem) == 1.0


def coefficient_rows(problem: Problem) -> tuple[Array, Array] | None:
    """Rows of c for yaw rate and forward speed at the nominal values; None for a robot without c, for one
    that also moves sideways, and for one whose motion does not follow from its inputs alone.
    """
    model = robot_of(problem.model)
    if len(model.coefficient_names) != 2 or follows_state(model):
        return None
    matrix = np.array(ca.evalf(model.coefficients(ca.DM(model.nominal))))
    return matrix[0], matrix[1]


def top_speeds(problem: Problem) -> Array | None:
    """Largest speed of the robot's origin in each period, (N,) [m/s]; None where it is not known."""
    rows, factor = coefficient_rows(problem), grip(problem)
    if rows is None or factor is None:
        return None
    return np.asarray(factor * input_reach(problem) @ np.abs(rows[1]))


def room(problem: Problem) -> tuple[float, float, float, float] | None:
    """A rectangle x_min, x_max, y_min, y_max that the robot's origin keeps to; None without a workspace."""
    found = workspace_of(problem.limits)
    if found is None:
        return None
    x_min, x_max, y_min, y_max = found.widened_extent(problem.excess)
    if not np.isfinite(x_min):
        return None
    own = robot_of(problem.model).body_radius
    return x_min + own, x_max - own, y_min + own, y_max - own


def path_budget(problem: Problem) -> float | None:
    """How far the robot's origin may go [m]; None where nothing limits it."""
    found = [limit for limit in problem.limits if isinstance(limit, PathLength)]
    return (1 + problem.excess) * found[0].bounds if found else None


def scales_lengths(problem: Problem, names: tuple[str, ...]) -> bool:
    """Whether growing the parameters `names` by one factor makes the same path larger by that factor.

    Then a step from a place farther out by the factor ends farther out by it, and nothing else changes:
    neither the heading nor any further state.
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
        drawn = rng.uniform(-1, 1, states), rng.uniform(low, high), nominal, rng.uniform(0.5, 2)
        now, changed = (np.array(one).ravel() for one in function(*drawn))
        expected = np.concatenate([now[:2], np.zeros(states - 2)])
        if not np.allclose(changed, expected, rtol=1e-9, atol=1e-12 + 1e-9 * np.abs(now).max()):
            return False
    return True
