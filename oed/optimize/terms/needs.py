"""What each limit needs of a drive: the inputs' splines, one instant after another, or whole runs.

A limit says what it looks at. It is taken at its word where two samples show that its rows are what it says;
any other limit is given whole runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.kernel.dynamics.embedding import Bounding
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.limit import Limit, Rows
from oed.kernel.problem import Problem
from oed.optimize.terms.base import small_drive, splines_of

Known = TypeVar("Known")


@dataclass(frozen=True)
class Asked:
    """How a limit is asked of instants: one thing of all of them after the other.

    Attributes:
        things: how many it asks of each.
        points: instants of a sample.
        first: whether a run's first instant is asked as well, as points of a path are.
    """

    things: int
    points: int
    first: bool


@dataclass(frozen=True)
class Needs:
    """A problem's limits by what they need, each by its place among them.

    Attributes:
        tables: rows of those that need the inputs' splines alone, linear in z (SX).
        asked: those that need one instant after another.
        whole: those that need whole runs.
    """

    tables: dict[int, Rows]
    asked: dict[int, Asked]
    whole: tuple[int, ...]

    def in_order(self, pieces: Sequence[Known], whole: Sequence[Known]) -> list[Known]:
        """What is known of the limits that pieces serve, and of the others, in the order of all limits."""
        served = sorted([*self.tables, *self.asked])
        found = dict(zip([*served, *self.whole], [*pieces, *whole], strict=True))
        return [found[place] for place in range(len(found))]


def needs_of(problem: Problem, bounding: Bounding, refine: int = 1) -> Needs:
    """What a problem's limits need.

    Args:
        problem: whose limits.
        bounding: what bounds the inputs, in terms of z (SX).
        refine: points of the path in a sample.
    """
    tables, asked, whole = dict[int, Rows](), dict[int, Asked](), list[int]()
    for place, limit in enumerate(problem.limits):
        if (rows := _on_splines(problem, limit, bounding)) is not None:
            tables[place] = rows
        elif (found := asked_of(problem, limit, refine)) is not None:
            asked[place] = found
        else:
            whole.append(place)
    return Needs(tables, asked, tuple(whole))


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


def asked_of(problem: Problem, limit: Limit, refine: int = 1) -> Asked | None:
    """How a limit on instants is asked of a drive with so many points of the path per sample; None of a limit
    whose rows are not those of its instants by themselves.

    Args:
        problem: whose drives they are.
        limit: on instants.
        refine: points of the path per sample.
    """
    if limit.looks_at != "state":
        return None
    drive = _numbers(problem, refine)
    whole, *samples = (_table(limit, one) for one in (drive, *(_sample(drive, k) for k in range(SAMPLES))))
    first = _table(limit, replace(_sample(drive, 0), path=drive.path[0, :]))
    each, spare = samples[0].shape[1], whole.shape[1] - SAMPLES * samples[0].shape[1]
    things = spare or each
    if spare not in (0, first.shape[1]) or not things or each % things:
        return None
    parts = [first[:, :, None]] if spare else []
    parts += [one.reshape(3, things, -1) for one in samples]
    together = np.concatenate(parts, axis=2).reshape(3, -1)
    same = np.allclose(together, whole, rtol=1e-12, atol=0)
    return Asked(things, each // things, bool(spare)) if same else None


SAMPLES = 2
"""How many show whether a limit is one on instants."""


def _numbers(problem: Problem, refine: int) -> Drive:
    # A drive of two samples with any numbers as its path and motion; nobody may ask for splines.
    rng, robot = np.random.default_rng(0), problem.system
    shape = (SAMPLES, len(robot.inputs))
    low, high = problem.input_bounds.T
    held = _number(rng.uniform(low / 2, high / 2, shape))
    drive = small_drive(problem, held, ca.SX.zeros(len(robot.states)), refine)
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
