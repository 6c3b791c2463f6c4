"""What each limit needs of a drive: the inputs' splines, one instant after another, or whole runs.

A limit says what it looks at. It is taken at its word where two samples show that its rows are what it says;
any other limit is given whole runs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from oed.kernel.dynamics.embedding import Bounding
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import Limit, Rows
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
    """Return whether a limit has rows of every instant by itself.

    It says so, and its rows on a drive of two samples are its rows on each of them: the same expressions of
    the same symbols.
    """
    if limit.looks_at != "state":
        return False
    drive, splines = _symbolic(problem)
    rows, *by_sample = (limit.rows(part) for part in (drive, *(_sample(drive, k) for k in range(SAMPLES))))
    first = limit.rows(replace(_sample(drive, 0), path=drive.path[0, :]))
    per_sample = len(by_sample[0].lower)
    spare = len(rows.lower) - SAMPLES * per_sample
    per_point = spare or per_sample
    if spare not in (0, len(first.lower)) or not per_point or per_sample % per_point:
        return False
    parts = [*([first] if spare else []), *by_sample]
    # Rows ask one thing of all instants after another.
    places = np.split(np.arange(len(rows.lower)), np.cumsum([len(part.lower) for part in parts])[:-1])
    order = np.concatenate([place.reshape(per_point, -1) for place in places], axis=1).ravel().tolist()
    together = ca.vertcat(*(_column(part) for part in parts))[order]
    bounds = [(part.lower, part.upper) for part in parts]
    lower, upper = (np.concatenate(ends)[order] for ends in zip(*bounds, strict=True))
    return (
        not ca.depends_on(_column(rows), splines)
        and np.array_equal(lower, rows.lower)
        and np.array_equal(upper, rows.upper)
        and all(map(_same, ca.vertsplit(together), ca.vertsplit(_column(rows))))
    )


SAMPLES = 2
"""Samples that show whether a limit is one on instants."""
DEPTH = 200
"""Operations one within the other to which two formulas are compared."""


def _symbolic(problem: Problem) -> tuple[Drive, Expression]:
    # A drive of two samples with symbols as its path and motion, and those of its splines.
    robot = problem.system
    shape = SAMPLES, len(robot.inputs)
    drive = small_drive(problem, ca.SX.sym("held", *shape), ca.SX.sym("start", len(robot.states)))
    values, rates, jerks = (ca.SX.sym(name, *shape) for name in ("values", "rates", "jerks"))
    drive = replace(
        drive,
        path=ca.SX.sym("path", *drive.path.shape),
        motion=ca.SX.sym("motion", *drive.motion.shape),
        input_values=values,
        input_rates=rates,
        input_jerks=jerks,
    )
    return drive, ca.veccat(values, rates, jerks)


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


def _column(rows: Rows) -> Expression:
    return ca.SX(ca.densify(ca.vec(rows.expression)))


def _same(first: Expression, second: Expression) -> bool:
    return bool(ca.is_equal(first, second, DEPTH))
