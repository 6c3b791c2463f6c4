"""Limits between the points: the most that a drive exceeds them at any time, by branch and bound.

Over a stretch of a period, a limit's rows are functions of the time elapsed alone. Their values at both ends
and bounds of their slopes tell how large they can be in between [Piyavskii, 1972]; stretches that may hold
more than has been found are halved, until what is found is the most there is, to `GAP`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed import spline
from oed.enclosures import ONE, Enclosure, Interval, NotEnclosed, enclosed, number
from oed.expression import Expression
from oed.limits.limit import Limit, PathLimit, Rows
from oed.models.model import Integration, Model
from oed.problem import Problem
from oed.robust import reserved
from oed.rollout import Moment, moment, roll_out
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]
Places = npt.NDArray[np.int64]

GAP = 1e-6
"""Share of a limit's size to which its largest excess is found."""
INSIDE = 1e-4
"""Share of the distance to a limit to which that is found, of drives that keep it."""
PARTS, FEW = 8, 64
"""Parts that each of a few stretches is cut into; many are halved."""
NARROWEST = 1e-9
"""Share of a period below which a stretch is not cut any more: where rows change from one formula to another no
bound gets close, but what they jump from and to they are at its ends."""
AT_ONCE = 1024
"""Stretches bounded in one call."""
PATIENCE = 200_000
"""Stretches bounded at most, besides 20 for every period, before a limit counts as checked at points only."""


@dataclass(frozen=True)
class Periods:
    """The periods of one drive, or of many robots with the same inputs, each by how it begins.

    Attributes:
        trajectory: whose inputs are held.
        states: at their begin, (drives * N, states), drive by drive.
        parameters: of the robots, (drives, p).
        sensitivities: of those states, by columns, (drives * N, s); s = 0 where nobody asks for them.
    """

    trajectory: Trajectory
    states: Array
    parameters: Array
    sensitivities: Array

    @cached_property
    def held(self) -> Array:
        """Inputs held in each period of a drive, (N, inputs)."""
        return self.trajectory.inputs

    @property
    def drives(self) -> int:
        """How many."""
        return len(self.parameters)

    def drive_of(self, rows: Places) -> Places:
        """The drives that periods belong to."""
        return np.asarray(rows // self.trajectory.samples)

    def place_of(self, rows: Places) -> Places:
        """Which of their drive's periods they are."""
        return np.asarray(rows % self.trajectory.samples)


@dataclass(frozen=True)
class Stretches:
    """Parts of periods: from a fraction of a period to another.

    Attributes:
        row: of the period, (K,).
        begin, end: fractions, (K,).
    """

    row: Places
    begin: Array
    end: Array

    def __len__(self) -> int:
        """K."""
        return len(self.row)

    def chosen(self, which: Any) -> Stretches:
        """Some of them."""
        return Stretches(self.row[which], self.begin[which], self.end[which])

    def cut(self, parts: int) -> Stretches:
        """So many equal ones of each."""
        edges = self.begin + (self.end - self.begin) * np.linspace(0, 1, parts + 1)[:, None]
        return Stretches(np.tile(self.row, parts), edges[:-1].ravel(), edges[1:].ravel())


class Excess:
    """By how much a limit's rows are exceeded at an instant, and how much at most over a stretch of a period.

    Attributes:
        size: of the limit.
        sensitive: whether the rows look at sensitivities.
        by_splines: whether they look at the inputs' splines between the middles of the periods.
    """

    def __init__(
        self,
        rows_of: Callable[[Moment], Rows],
        model: Model,
        integration: Integration,
        *,
        sensitive: bool = False,
        run: int = 0,
    ) -> None:
        """Write the rows of an instant and bound them.

        Raises:
            NotEnclosed: an operation that no bounds are known for.
        """
        states, parameters, inputs = len(model.states), len(model.parameters), len(model.inputs)
        self.sensitive = sensitive
        self._given = [
            ca.SX.sym("state", states),
            ca.SX.sym("inputs", inputs),
            ca.SX.sym("p", parameters),
            ca.SX.sym("S", states * (parameters + states) if sensitive else 0),
            ca.SX.sym("period"),
        ]
        state, held, robot, slopes, period = self._given
        asked, fraction = ca.SX.sym("asked", inputs), ca.SX.sym("fraction")
        instant = moment(
            model,
            integration,
            state=state,
            inputs=held,
            asked=asked,
            parameters=robot,
            elapsed=fraction * period,
            begin_sensitivities=ca.reshape(slopes, states, -1) if sensitive else None,
            run=run,
        )
        rows = rows_of(instant)
        self.size, excess = rows.size, ca.cse(exceeded(rows))
        self.by_splines = bool(ca.depends_on(excess, asked))
        self._at = ca.Function("at", [*self._given, asked, fraction], [excess])
        self._over = self._bounded(inputs)
        self._mapped: dict[tuple[str, int], ca.Function] = {}

    def _bounded(self, inputs: int) -> ca.Function:
        asked = [ca.SX.sym(name, inputs) for name in ("low", "high", "slope_low", "slope_high")]
        begin, end = ca.SX.sym("begin"), ca.SX.sym("end")
        each = zip(*(ca.vertsplit(one) for one in asked), strict=True)
        entries = [Enclosure(Interval(low, high), Interval(least, most)) for low, high, least, most in each]
        points = [[Enclosure(number(one)) for one in ca.vertsplit(given)] for given in self._given]
        if not self.by_splines:
            entries = [Enclosure(number(0.0))] * inputs
        found = enclosed(self._at, [*points, entries, [Enclosure(Interval(begin, end), ONE)]])
        results = [
            ca.vertcat(*(one.value.high for one in found)),
            ca.vertcat(*(one.slope.low for one in found)),
            ca.vertcat(*(one.slope.high for one in found)),
        ]
        return ca.Function("over", [*self._given, *asked, begin, end], ca.cse(results))

    def whole(self, periods: Periods) -> Stretches:
        """All periods; cut where splines have knots, if the rows look at them."""
        drive = periods.trajectory
        if not self.by_splines:
            rows = np.arange(len(periods.states))
            return Stretches(rows, np.zeros(len(rows)), np.ones(len(rows)))
        cuts = [_cuts(one) for one in drive.each]
        each = drive.samples // drive.runs
        begins, ends = (np.concatenate([cut[side] for cut in cuts]) for side in (1, 2))
        rows = np.concatenate([run * each + row for run, (row, _, _) in enumerate(cuts)])
        return Stretches(rows, begins, ends)

    def over(self, periods: Periods, stretches: Stretches) -> tuple[Array, Array]:
        """The larger excess of both ends, and the largest there may be between, (K,) each."""
        parts = [
            self._some(periods, stretches.chosen(slice(first, first + AT_ONCE)))
            for first in range(0, len(stretches), AT_ONCE)
        ]
        found, bounds = zip(*parts, strict=True)
        return np.concatenate(found), np.concatenate(bounds)

    def _some(self, periods: Periods, stretches: Stretches) -> tuple[Array, Array]:
        count, place = len(stretches), periods.place_of(stretches.row)
        given = [
            periods.states[stretches.row],
            periods.held[place],
            periods.parameters[periods.drive_of(stretches.row)],
            periods.sensitivities[stretches.row] if self.sensitive else np.zeros((count, 0)),
            np.full((count, 1), periods.trajectory.period),
        ]
        splines = self._splines(periods.trajectory, place, stretches)
        fractions = [stretches.begin[:, None], stretches.end[:, None]]
        first, last = (
            self._call("at", self._at, [*given, asked, fraction])[0]
            for asked, fraction in zip(splines[:2], fractions, strict=True)
        )
        high, least, most = self._call("over", self._over, [*given, *splines[2:], *fractions])
        peaks = _peak(first, last, least, most, fractions[1] - fractions[0])
        found = np.maximum(first, last).max(axis=1)
        bounds = np.fmin(peaks, np.where(np.isnan(high), np.inf, high)).max(axis=1)
        return np.where(np.isnan(found), np.inf, found), np.maximum(bounds, found)

    def _splines(self, drive: Trajectory, place: Places, stretches: Stretches) -> list[Array]:
        # The splines' values at both ends, and bounds of values and slopes (by the fraction) between.
        tables = np.zeros((6, len(stretches), drive.coefficients.shape[1]))
        if not self.by_splines:
            return list(tables)
        each = drive.samples // drive.runs
        for run, one in enumerate(drive.each):
            own = place // each == run
            begin, end = (
                (place % each + side)[own] * drive.period for side in (stretches.begin, stretches.end)
            )
            low, high, least, most = spline.enclosure(one.knots, one.degree, one.coefficients, begin, end)
            # A piecewise constant spline has its value of the stretch at both its ends.
            ends = [low, low] if one.degree == 0 else [one.inputs_at(begin), one.inputs_at(end)]
            tables[:, own] = [*ends, low, high, least * drive.period, most * drive.period]
        return list(tables)

    def _call(self, name: str, function: ca.Function, arguments: list[Array]) -> list[Array]:
        # Mapped over a power of two: few maps serve all numbers of stretches.
        count = len(arguments[0])
        size = 1 << (count - 1).bit_length()
        if (name, size) not in self._mapped:
            self._mapped[name, size] = function.map(size)
        filled = [np.concatenate([one, np.repeat(one[:1], size - count, axis=0)]).T for one in arguments]
        found = self._mapped[name, size].call(filled)
        return [np.array(one).T[:count] for one in found]


def exceeded(rows: Rows) -> Expression:
    """By how much each side of each row is exceeded."""
    values = ca.vec(rows.expression)
    sides = [values[place] - bound for place, bound in enumerate(rows.upper.tolist()) if np.isfinite(bound)]
    sides += [bound - values[place] for place, bound in enumerate(rows.lower.tolist()) if np.isfinite(bound)]
    return ca.densify(ca.vertcat(*sides))


def _cuts(run: Trajectory) -> tuple[Places, Array, Array]:
    # The parts of a run's periods between its knots: the period, from which fraction to which.
    grid = np.arange(run.samples + 1) * run.period
    knots = run.knots[np.abs(run.knots[:, None] - grid).min(axis=1) > NARROWEST * run.period]
    edges = np.sort(np.concatenate([grid, np.unique(knots)])) / run.period
    rows = np.minimum(((edges[:-1] + edges[1:]) / 2).astype(int), run.samples - 1)
    return rows, edges[:-1] - rows, edges[1:] - rows


def _peak(begin: Array, end: Array, least: Array, most: Array, width: Array) -> Array:
    # The highest that a function can be with these values at both ends and slopes within these bounds.
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        after = (end - begin - least * width) / (most - least)
        between = begin + most * after
    between = np.where(np.isfinite(between), between, np.inf)
    peak = np.where(least >= 0, end, np.where(most <= 0, begin, between))
    return np.asarray(np.maximum(peak, np.maximum(begin, end)))


def largest(
    excess: Excess,
    periods: Periods,
    found: Array,
    *,
    enough: Array | float = np.inf,
    stretches: Stretches | None = None,
) -> tuple[Array, npt.NDArray[np.bool_]]:
    """The largest excess of each drive at any time, (drives,), and whether it is sure, to `GAP`.

    Args:
        excess: of a limit.
        periods: of the drives.
        found: excess found before, (drives,): stretches that cannot hold more are left alone.
        enough: excess above which a drive's is not looked for any further.
        stretches: to look at; the whole drives by default.
    """
    found = np.array(found, dtype=float)
    highest, sure = found.copy(), np.ones(len(found), dtype=bool)
    left = PATIENCE + 20 * len(periods.states)
    stretches = excess.whole(periods) if stretches is None else stretches
    while len(stretches):
        values, bounds = excess.over(periods, stretches)
        drives = periods.drive_of(stretches.row)
        np.maximum.at(found, drives, values)
        left -= len(stretches)
        ceiling = (found + gap_of(excess.size, found))[drives]
        closed = (bounds <= ceiling) | (found > enough)[drives]
        closed |= stretches.end - stretches.begin < NARROWEST
        np.maximum.at(highest, drives[closed], np.minimum(bounds, ceiling)[closed])
        stretches = stretches.chosen(~closed)
        if left < 0:
            sure[drives[~closed]] = False
            break
        stretches = stretches.cut(PARTS if len(stretches) < FEW else 2)
    # Well inside, the bounds are as wide as that is far; what has been found is what is told then.
    return np.where(found < 0, found, np.maximum(highest, found)), sure


def gap_of(size: float, found: Array) -> Array:
    """How closely the largest excess is found: to a share of the limit's size, or of the distance to it."""
    return np.maximum(GAP * size, -INSIDE * found)


def near(limit: Limit, size: float, drive: Trajectory, points: Array, speeds: Array) -> Stretches | None:
    """The stretches of a drive that may exceed a limit on its path by more than its points do.

    Args:
        limit: on the path.
        size: its own.
        drive: with equally many points in every period.
        points: excess at each of them, (G,), both ends of every run included.
        speeds: of the robot's origin in every period [m/s], (N,).

    Returns:
        None where the limit does not say how much it changes along the path.
    """
    if not isinstance(limit, PathLimit) or not np.isfinite(limit.per_metre):
        return None
    runs = points.reshape(drive.runs, -1)
    each = drive.samples // drive.runs
    refine = (runs.shape[1] - 1) // each
    reach = np.repeat(speeds, refine) * limit.per_metre * drive.period / refine / 2
    highest = np.maximum(runs[:, :-1], runs[:, 1:]).ravel() + reach
    found = points.max()
    (chosen,) = np.nonzero(~(highest <= found + gap_of(size, found)))
    part = chosen % refine
    return Stretches(chosen // refine, part / refine, (part + 1) / refine)


def periods_of(
    model: Model,
    integration: Integration,
    trajectory: Trajectory,
    parameters: Array,
    starts: Array,
    *,
    sensitive: bool = False,
) -> Periods:
    """The periods of robots with parameters (drives, p) from starts (drives, runs, states)."""
    count, states = len(parameters), len(model.states)
    function = _rolled(model, integration, trajectory.samples, trajectory.runs, sensitive)
    mapped = function.map("robots", "serial", count, [0, 1], []) if count > 1 else function
    begun = starts.transpose(1, 0, 2).reshape(trajectory.runs, -1)
    poses, slopes = mapped(trajectory.inputs, trajectory.period, parameters.T, begun)
    table = np.array(poses).reshape(trajectory.samples, count, states).transpose(1, 0, 2)
    width = len(model.parameters) + states if sensitive else 0
    wide = np.array(slopes).reshape(states, count * trajectory.samples, width).transpose(1, 2, 0)
    return Periods(trajectory, table.reshape(-1, states), parameters, wide.reshape(count * len(table[0]), -1))


@lru_cache(maxsize=16)
def _rolled(model: Model, integration: Integration, samples: int, runs: int, sensitive: bool) -> ca.Function:
    # (inputs, period, parameters, starts) -> states at the begin of every period, and their sensitivities.
    inputs, period = ca.MX.sym("inputs", samples, len(model.inputs)), ca.MX.sym("period")
    parameters = ca.MX.sym("parameters", len(model.parameters))
    start = ca.MX.sym("start", runs, len(model.states))
    drive = roll_out(
        model, integration, inputs=inputs, start=start, parameters=parameters, period=period, runs=runs
    )
    states, width = len(model.states), len(model.parameters) + len(model.states)
    columns = (np.array(drive.begins)[:, None] * width + np.arange(width)).ravel().tolist()
    slopes = drive.sensitivities[:, columns] if sensitive else ca.MX(states, 0)
    return ca.Function("rolled", [inputs, period, parameters, start], [drive.poses[drive.begins, :], slopes])


def most_exceeded(
    problem: Problem, limit: Limit, drive: Trajectory, found: float, stretches: Stretches | None = None
) -> tuple[float, bool]:
    """The most that a drive exceeds a problem's limit at any time, given what it does at some of them, and
    whether that is sure.

    `stretches` are those to look at of the nominal robot's drive; all by default.
    """
    if limit.looks_at != "state":
        return found, limit.looks_at is not None
    certain = True
    try:
        for excess, periods in _looked_at(problem, limit, drive):
            (found,), (sure,) = largest(excess, periods, np.array([found]), stretches=stretches)
            certain = certain and bool(sure)
    except NotEnclosed:
        return found, False
    return float(found), certain


def _looked_at(problem: Problem, limit: Limit, drive: Trajectory) -> Iterator[tuple[Excess, Periods]]:
    # The nominal robot, with what is kept in reserve; and the other robots that are to keep the limit.
    robust, spread, rule = problem.robust, problem.spread, problem.design.integration
    if robust is None or spread is None or not isinstance(limit, PathLimit):
        robot = problem.robot
        yield (
            excess_of(limit, robot, rule),
            _of_one(robot, rule, drive, np.array(robot.nominal), drive.starts),
        )
        return
    robot = spread.robot
    if robust.kind != "scenarios":
        for run, one in enumerate(drive.each):
            nominal = _of_one(robot, rule, one, np.array(robot.nominal), one.starts, sensitive=True)
            yield _reserved(problem, limit, run), nominal
    values = robust.scenarios(spread)
    if robust.kind == "scenarios":
        values = np.vstack([spread.nominal, values])
    starts = drive.starts + spread.shifts(values)
    for parameters, start in zip(spread.robots(values), starts, strict=True):
        yield excess_of(limit, robot, rule), _of_one(robot, rule, drive, parameters, start)


def _of_one(
    robot: Model,
    rule: Integration,
    drive: Trajectory,
    parameters: Array,
    starts: Array,
    *,
    sensitive: bool = False,
) -> Periods:
    return periods_of(robot, rule, drive, parameters[None, :], starts[None, :], sensitive=sensitive)


@lru_cache(maxsize=128)
def excess_of(limit: Limit, robot: Model, rule: Integration) -> Excess:
    """A limit's excess as it stands."""
    return Excess(limit.rows, robot, rule)


@lru_cache(maxsize=32)
def _reserved(problem: Problem, limit: PathLimit, run: int) -> Excess:
    spread, robust = problem.spread, problem.robust
    assert spread is not None
    assert robust is not None

    def rows(instant: Moment) -> Rows:
        return reserved(limit, instant, spread, robust)

    return Excess(rows, spread.robot, problem.design.integration, sensitive=True, run=run)
