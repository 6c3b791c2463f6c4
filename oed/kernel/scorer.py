"""The one scorer of trajectories: what is said of them by a problem's own integration steps.

Searches score by it; what is reported comes from `evaluate`, which takes steps that are fine enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from oed.foundation.arrays import Array
from oed.foundation.errors import Issue, NotFinite
from oed.kernel.between import GAP, ScoredDrive, most_exceeded
from oed.kernel.dynamics.direct_call import GroupedFunction
from oed.kernel.dynamics.rollout import FINE, any_drive
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.finiteness import require_driven, require_measured
from oed.kernel.limit import Limit, Rows
from oed.kernel.measurement.information import Estimation
from oed.kernel.measurement.square_root import SquareRoot
from oed.kernel.parts import root_weights, taken_of
from oed.kernel.problem import Problem
from oed.kernel.repetitions import carried_out, repetitions
from oed.kernel.results import Evaluation, Margin

EXTREMES = ("input_values", "input_rates", "input_jerks", "motion_inputs")
"""Extremes of a drive's splines, as `roll_out` takes them."""

NEVER = 1e-6
"""Share of a period within which readings never follow each other."""


def score(problem: Problem, trajectory: Trajectory) -> Evaluation:
    """Score a trajectory as `evaluate` does, by the problem's own steps however coarse they are.

    Args:
        problem: problem that scores it.
        trajectory: trajectory to score.

    Raises:
        ValueError, NotFinite: see `evaluate`.
    """
    scorer, extremes = _scorer_of(problem, trajectory)
    return scorer.evaluation(trajectory, extremes)


def full_information(problem: Problem, trajectory: Trajectory) -> dict[str, SquareRoot]:
    """A trajectory's `full_square_roots` alone, whatever limits it keeps.

    Raises:
        ValueError, NotFinite: see `evaluate`.
    """
    scorer, _ = _scorer_of(problem, trajectory)
    *_, jacobians, magnitudes = scorer.measured(trajectory)
    _, full = scorer.square_roots(jacobians, magnitudes)
    return {part.block.name: root for part, root in zip(scorer.estimations, full, strict=True)}


def jacobians(problem: Problem, trajectory: Trajectory) -> tuple[Array, ...]:
    """Derivatives of a trajectory's readings, by every block's parameters and nuisances, (rows, n) each.

    Raises:
        ValueError, NotFinite: see `evaluate`.
    """
    scorer, _ = _scorer_of(problem, trajectory)
    return tuple(scorer.measured(trajectory)[2])


def precision_over_time(problem: Problem, trajectory: Trajectory, times: Array) -> Array:
    """Standard deviations (n, p), SI, of what sensors estimate by every run's readings until times (n,) [s];
    infinite of what these do not identify.

    Under drift a time's readings are innovations, which say what is new beside all readings before.

    Args:
        problem: problem with the sensors.
        trajectory: trajectory to score.
        times: [s].

    Raises:
        ValueError, NotFinite: see `evaluate`.
    """
    scorer, _ = _scorer_of(problem, trajectory)
    *_, (jacobian,), (magnitudes,) = scorer.measured(trajectory)
    (estimation,), parts = scorer.estimations, taken_of(problem.sensors, problem.system, trajectory)
    read = np.array([reading.time for reading in parts.readings])[parts.places]
    # What is read at a time counts, however that is rounded.
    until = [jacobian * (read <= time + NEVER * trajectory.period)[:, None] for time in times]
    roots = [estimation.square_roots(rows, magnitudes.ravel())[1] for rows in until]
    return np.sqrt([np.diag(root.covariance) for root in roots])


def limits_exceeded(problem: Problem, trajectory: Trajectory, share: float) -> frozenset[str]:
    """Names of the limits that a trajectory exceeds by more than a share of their size: as by the margins of
    `evaluate`, for less, because nobody asks how large these are.

    Args:
        problem: problem with the limits.
        trajectory: trajectory to score.
        share: share of each limit's size.

    Raises:
        ValueError, NotFinite: see `evaluate`.
    """
    scorer, extremes = _scorer_of(problem, trajectory)
    margins = scorer.margins(trajectory, extremes, share)
    return frozenset(margin.name for margin in margins if margin.violation > share * margin.size)


def _scorer_of(problem: Problem, trajectory: Trajectory) -> tuple[_Scorer, list[Array]]:
    # The scorer of a trajectory, and its splines' extremes, which are further arguments.
    require_shape(problem, trajectory)
    extremes = _extremes_of(problem, trajectory)
    return _scorer(problem, trajectory.samples, trajectory.runs, *map(len, extremes)), extremes


def _extremes_of(problem: Problem, trajectory: Trajectory) -> list[Array]:
    extremes = [trajectory.extremes(order) for order in range(3)]
    return [*extremes, _dense_inputs(trajectory) if _checked_at_points(problem) else trajectory.inputs]


def require_shape(problem: Problem, trajectory: Trajectory) -> None:
    """Refuse a trajectory of another system.

    Raises:
        ValueError: inputs or states that do not match the system's, another number of runs.
    """
    expected = len(problem.model.inputs)
    if trajectory.coefficients.shape[1] != expected:
        names = ", ".join(problem.model.input_names)
        raise ValueError(f"expected {expected} inputs ({names}), got {trajectory.coefficients.shape[1]}")
    states, runs = len(problem.model.states), problem.design.runs
    if trajectory.starts.shape != (runs, states):
        raise ValueError(
            f"expected start of {runs} run(s), {states} states each, got {trajectory.start.shape}"
        )


class _Scorer:
    """The compiled functions that score trajectories of one number of samples."""

    def __init__(self, problem: Problem, samples: int, runs: int, *counts: int) -> None:
        system = problem.system
        self._extremes = [ca.MX.sym("extremes", count, len(system.inputs)) for count in counts]
        splines = dict(zip(EXTREMES, self._extremes, strict=True))
        if not _checked_at_points(problem):
            splines["motion_inputs"] = None
        self._symbols, drive = any_drive(system, samples, runs, refine=FINE, **splines)
        self._repetitions = ca.MX.sym("repetitions", samples)
        self._drive = replace(drive, repetitions=self._repetitions)
        self.problem = problem

    @cached_property
    def rows(self) -> list[Rows]:
        """The limits'; what only asks for information does not pay for them."""
        return self.problem.limit_rows(self._drive)

    @cached_property
    def estimations(self) -> Sequence[Estimation]:
        """Estimations on this number of samples; a score of limits alone does not pay for them."""
        return self.problem.estimations(self._drive)

    @cached_property
    def _of_driving(self) -> GroupedFunction:
        drive = self._drive
        groups = [
            [drive.path_length(), drive.states, drive.path, drive.speeds],
            [rows.expression for rows in self.rows],
        ]
        return GroupedFunction("driven", [*self._symbols, *self._extremes, self._repetitions], groups)

    @cached_property
    def _of_measuring(self) -> GroupedFunction:
        groups = [
            # Those of sensors are the jacobian's first columns.
            [
                ca.DM(0, 0) if part.block.design_matrix is None else part.block.design_matrix
                for part in self.estimations
            ],
            [part.block.response for part in self.estimations],
            [part.block.jacobian for part in self.estimations],
            [part.block.magnitudes for part in self.estimations],
            [self._drive.states],
        ]
        return GroupedFunction("measured", self._symbols, groups)

    def _robots(self, trajectory: Trajectory, roots: Sequence[SquareRoot]) -> list[Sequence[SquareRoot]]:
        # What the criterion sees of every robot that is judged.
        problem = self.problem
        if problem.robust is None or problem.robust.objective == "nominal":
            return [roots]
        robots = []
        for parameters, shift in problem.judged_systems:
            _, _, jacobians, magnitudes, _ = self._read(trajectory, parameters, shift)
            robots.append(self.square_roots(jacobians, magnitudes)[0])
        return robots

    def _read(
        self, drive: Trajectory, parameters: Array | None = None, shift: Array | float = 0.0
    ) -> list[list[Array]]:
        # Regressors, responses, jacobians and what their columns add up, of every block; the states.
        robot = self.problem.system.nominal if parameters is None else parameters
        arguments = drive.inputs.T, (drive.starts + shift).T, np.array(robot), np.array(drive.period)
        groups = self._of_measuring.values(*arguments)
        roots = root_weights(self.problem.sensors, self.problem.system, drive)
        if roots is not None:
            # A reading that counts w times says as much as w readings.
            groups[2] = [roots[:, None] * jacobian for jacobian in groups[2]]
        return groups

    def square_roots(
        self, jacobians: Sequence[Array], magnitudes: Sequence[Array]
    ) -> tuple[Sequence[SquareRoot], Sequence[SquareRoot]]:
        """Return information of each block: what the criterion sees, and on all its estimated parameters."""
        triples = zip(self.estimations, jacobians, magnitudes, strict=True)
        pairs = [part.square_roots(jacobian, sizes.ravel()) for part, jacobian, sizes in triples]
        judged, full = zip(*pairs, strict=True)
        return judged, full

    def _driven(self, drive: Trajectory, extremes: Sequence[Array]) -> tuple[list[Array], list[Array]]:
        # Its length, states at the samples, path and speeds; the limits' rows.
        problem, robot = self.problem, np.array(self.problem.system.nominal)
        arguments = drive.inputs.T, drive.starts.T, robot, np.array(drive.period)
        tables = [values.T for values in extremes]
        driven, limits = self._of_driving.values(*arguments, *tables, repetitions(problem, drive))
        require_driven(problem, drive, driven[2])
        return driven, limits

    def measured(self, drive: Trajectory) -> list[list[Array]]:
        """Return regressors, responses, jacobians and what their columns add up, of every block."""
        *groups, (states,) = self._read(drive)
        require_driven(self.problem, drive, states)
        require_measured(self.problem, drive, groups[1], groups[2])
        return groups

    def margins(
        self,
        trajectory: Trajectory,
        extremes: Sequence[Array],
        share: float | None = None,
        scored: tuple[list[Array], list[Array]] | None = None,
    ) -> tuple[Margin, ...]:
        """Return the margins of all limits, those of the trials that are carried out.

        Args:
            trajectory: the drive.
            extremes: extremes of its splines.
            share: if only larger violations count, this share of a limit's size.
            scored: results of the drive as it is, if they are known.
        """
        problem, drive = self.problem, carried_out(self.problem, trajectory)
        if drive is not trajectory:
            extremes, scored = _extremes_of(problem, drive), None
        (_, states, _, speeds), limits = scored or self._driven(drive, extremes)
        scored_drive = ScoredDrive.of(problem, drive, states, speeds.ravel())
        margins = [
            _margin(problem, limit, scored_drive, rows, values.ravel(), share)
            for limit, rows, values in zip(problem.limits, self.rows, limits, strict=True)
        ]
        margins += _conditions(problem, trajectory)
        if problem.selection is not None:
            sensors = problem.sensors
            margins += problem.selection.margins(sensors, problem.system, trajectory)
        return tuple(margins)

    def evaluation(self, trajectory: Trajectory, extremes: Sequence[Array]) -> Evaluation:
        problem = self.problem
        driven, limits = self._driven(trajectory, extremes)
        regressors, responses, jacobians, summed = self.measured(trajectory)
        length, states, path, _ = driven
        designs = [
            regressor if part.block.raw else jacobian[:, : len(part.block.parameters)]
            for part, regressor, jacobian in zip(self.estimations, regressors, jacobians, strict=True)
        ]
        roots, full = self.square_roots(jacobians, summed)
        robots, criterion = self._robots(trajectory, roots), problem.objective
        # Of the paper's regressors W is what it is, of sensors what is left of it.
        singular = [
            (SquareRoot.of_rows(design) if part.block.raw else root).singular_values
            for part, design, root in zip(self.estimations, designs, roots, strict=True)
        ]
        names = [part.block.name for part in self.estimations]
        return Evaluation(
            objective=float(problem.together([float(criterion.judge(robot)) for robot in robots])),
            singular_values=np.sort(np.concatenate(singular))[::-1],
            norm_y=float(np.linalg.norm(np.concatenate(responses))),
            path_length=float(length.item()),
            margins=self.margins(trajectory, extremes, scored=(driven, limits)),
            design_matrices=dict(zip(names, designs, strict=True)),
            square_roots=dict(zip(names, roots, strict=True)),
            full_square_roots=dict(zip(names, full, strict=True)),
            identifiable=all(bool(criterion.identifiable(robot)) for robot in robots),
            covariances={
                part.block.name: root.covariance
                for part, root in zip(self.estimations, full, strict=True)
                if part.block.noise is not None
            },
            parameters={part.block.name: part.parameters for part in self.estimations},
            states=states,
            path=path,
            nominal={
                name: value
                for part in self.estimations
                for name, value in zip(part.parameters, part.nominal.tolist(), strict=True)
            },
            units={
                name: unit
                for part in self.estimations
                for name, unit in zip(part.parameters, part.units, strict=True)
            },
        )


_scorer = lru_cache(maxsize=64)(_Scorer)


def _checked_at_points(problem: Problem) -> bool:
    return any(limit.looks_at is None for limit in problem.limits)


def _dense_inputs(trajectory: Trajectory) -> Array:
    # What the splines ask for between the samples too: for limits that are checked at points only.
    times = [np.linspace(0.0, run.duration, FINE * run.samples + 1) for run in trajectory.each]
    return np.concatenate(
        [run.inputs_at(moments) for run, moments in zip(trajectory.each, times, strict=True)]
    )


def _margin(
    problem: Problem, limit: Limit, scored_drive: ScoredDrive, rows: Rows, values: Array, share: float | None
) -> Margin:
    # Where only a violation by more than a share of the limit's size counts, it is no closer than that.
    if np.isnan(values).any():
        raise NotFinite(Issue(("limits", limit.name), "not a number somewhere along the drive"))
    # Between the points the limit is looked at as it stands; where it is widened, so are the margins.
    spare = problem.excess * rows.size
    excess = np.maximum(values - rows.upper, rows.lower - values) + spare
    # Nothing to satisfy, as with a limit of changes on a drive of one sample, is satisfied as at rest.
    excess = excess if excess.size else np.array([-rows.size])
    window = (-np.inf, np.inf) if share is None else (spare - GAP * rows.size, spare + share * rows.size)
    most, certain = most_exceeded(problem, limit, scored_drive, excess, window)
    return Margin(limit.name, spare - limit.amount(most), rows.size, rows.unit, certain)


def _conditions(problem: Problem, trajectory: Trajectory) -> list[Margin]:
    # What the design space itself asks; a solver's design keeps it by construction, a user's path may not.
    space, model = problem.design, problem.model
    if not model.states:
        # Settings take no time: there are only so many.
        remaining = space.all_samples - trajectory.samples
        return [Margin("settings", float(remaining), float(space.all_samples), "")]
    spare = space.whole_duration - trajectory.duration
    margins = [Margin("duration", spare, space.whole_duration, "s")]
    shortest = space.runs * (space.shortest_duration or 0.0)
    if shortest:
        margins.append(Margin("shortest_duration", trajectory.duration - shortest, shortest, "s"))
    if problem.fixed_starts is not None:
        apart = np.abs(trajectory.starts - problem.fixed_starts)
        if not model.velocity_signal:
            # States of any size; those of robots are metres and radians.
            sizes = np.abs(problem.fixed_starts)
            apart = apart / np.where(sizes > 0, sizes, 1.0)
        offset = float(apart.max(initial=0.0))
        unit = " or ".join(dict.fromkeys(model.state_units[: model.chosen_states]))
        margins.append(Margin("start", problem.start_spare - offset, 1.0, unit))
    elif problem.starts.bounded:
        outside = problem.starts.excess(trajectory.starts)
        margins.append(Margin("start", problem.start_spare - outside, 1.0, ""))
    if space.rest_to_rest and model.inputs:
        size = float(np.abs(problem.input_bounds).max())
        spare = problem.rest_spare - float(np.abs(trajectory.ends).max())
        margins.append(Margin("rest_to_rest", spare, size, model.inputs[0].unit))
    return margins
