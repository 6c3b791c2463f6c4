"""What each limit needs of a drive: the inputs' splines, one instant after another, or whole runs.

A limit says what it looks at. It is taken at its word where two samples show that its rows are what it says;
any other limit is given whole runs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.embedding import Bounding
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import Limit, PathLimit, Rows
from oed.kernel.problem import Problem
from oed.optimize.terms.small_drives import small_drive, splines_of


@dataclass(frozen=True)
class Needs:
    """A problem's limits by what they need, each by its place among them.

    Attributes:
        tables: rows of those that need the inputs' splines alone, linear in z (SX).
        instants: those that need one instant after another.
        whole: those that need whole runs.
    """

    tables: dict[int, Rows]
    instants: tuple[int, ...]
    whole: tuple[int, ...]


def needs_of(problem: Problem, bounding: Bounding) -> Needs:
    """Return the parts of a drive that a problem's limits need.

    Args:
        problem: whose limits.
        bounding: what bounds the inputs, in terms of z (SX).
    """
    tables, instants, whole = dict[int, Rows](), list[int](), list[int]()
    for place, limit in enumerate(problem.limits):
        if (rows := _on_splines(problem, limit, bounding)) is not None:
            tables[place] = rows
        elif by_instants(problem, limit):
            instants.append(place)
        else:
            whole.append(place)
    return Needs(tables, tuple(instants), tuple(whole))


def _on_splines(problem: Problem, limit: Limit, bounding: Bounding) -> Rows | None:
    # Rows that are linear in the splines, and look neither at what is held in a sample nor at a state.
    if limit.looks_at != "inputs":
        return None
    robot = problem.system
    held, start = ca.SX.sym("held", 1, len(robot.inputs)), ca.SX.sym("start", len(robot.states))
    drive = small_drive(problem, held, start)
    rows = limit.rows(splines_of(drive, bounding))
    expression, unknowns = ca.SX(ca.densify(rows.expression)), ca.vertcat(*ca.symvar(bounding.values))
    bent = any(ca.which_depends(expression, unknowns, 2, True))
    return None if bent or ca.depends_on(expression, ca.veccat(held, start)) else rows


def by_instants(problem: Problem, limit: Limit) -> bool:
    """Return whether a limit has rows of every instant by itself, of the nominal robot alone."""
    if limit.looks_at != "state" or (problem.robust is not None and isinstance(limit, PathLimit)):
        return False
    drive = _numbers(problem)
    table, *samples = (_table(limit, part) for part in (drive, *(_sample(drive, k) for k in range(SAMPLES))))
    first = _table(limit, replace(_sample(drive, 0), path=drive.path[0, :]))
    per_sample, spare = samples[0].shape[1], table.shape[1] - SAMPLES * samples[0].shape[1]
    per_point = spare or per_sample
    if spare not in (0, first.shape[1]) or not per_point or per_sample % per_point:
        return False
    parts = [first[:, :, None]] if spare else []
    parts += [part.reshape(3, per_point, -1) for part in samples]
    together = np.concatenate(parts, axis=2).reshape(3, -1)
    return bool(np.allclose(together, table, rtol=1e-12, atol=0))


SAMPLES = 2
"""How many show whether a limit is one on instants."""


def _numbers(problem: Problem) -> Drive:
    # A drive of two samples with any numbers as its path and motion; nobody may ask for splines.
    rng, robot = np.random.default_rng(0), problem.system
    shape = (SAMPLES, len(robot.inputs))
    low, high = problem.input_bounds.T
    held = _number(rng.uniform(low / 2, high / 2, shape))
    drive = small_drive(problem, held, ca.SX.zeros(len(robot.states)))
    unknown = _number(np.full(shape, np.nan))
    return replace(
        drive,
        path=_number(rng.uniform(0.1, 0.3, drive.path.shape)),
        motion=_number(rng.uniform(0.1, 0.3, drive.motion.shape)),
        input_values=unknown,
        input_rates=unknown,
        input_jerks=unknown,
    )


def _number(values: Array) -> Expression:
    return ca.SX(ca.DM(values))


def _sample(drive: Drive, place: int) -> Drive:
    # One sample of such a drive. What is known of it at several instants stands one after the other.
    first = 1 + place * drive.refine
    return replace(
        drive,
        inputs=drive.inputs[place::SAMPLES, :],
        motion=drive.motion[place::SAMPLES, :],
        signals={name: signal[place::SAMPLES, :] for name, signal in drive.signals.items()},
        states=drive.states[place : place + 2, :],
        path=drive.path[first : first + drive.refine, :],
    )


def _table(limit: Limit, drive: Drive) -> Array:
    # Values, lower and upper bounds of its rows, (3, rows).
    rows = limit.rows(drive)
    values = np.array(ca.evalf(ca.densify(rows.expression))).ravel(order="F")
    return np.array([values, rows.lower, rows.upper])
