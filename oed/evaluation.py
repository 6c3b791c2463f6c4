"""`evaluate`: the one scorer of trajectories.

Every number that anything reports about a trajectory (solvers, baselines, bounds, reports) comes from here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.errors import Flaw, NotFinite
from oed.finiteness import require_finite
from oed.limits.limit import Rows
from oed.problem import Problem
from oed.rollout import FINE, roll_out
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-3
"""A limit counts as kept when it is exceeded by at most this share of its size, and as active within it."""

ROUNDING = 1e-11
"""Share of what is told of parameters alone, below which what is told of a combination is rounding."""

SINGULAR = 1e-9
"""Share of lambda_max below which lambda_min counts as 0."""


@dataclass(frozen=True)
class Margin:
    """How far a trajectory stays inside one limit.

    Attributes:
        name: of the limit.
        margin: distance to the limit at the closest time, in `unit`; negative when it is exceeded.
        size: the limit's size in `unit`.
        unit: SI unit.
    """

    name: str
    margin: float
    size: float
    unit: str

    @property
    def active(self) -> bool:
        """Whether the trajectory touches the limit (or exceeds it)."""
        return self.margin <= TOLERANCE * self.size

    @property
    def violation(self) -> float:
        """Amount by which the limit is exceeded, 0 where it is kept."""
        return max(0.0, -self.margin)

    @property
    def kept(self) -> bool:
        """Whether the limit is kept, within `TOLERANCE` of its size."""
        return self.violation <= TOLERANCE * self.size


@dataclass(frozen=True)
class Evaluation:
    """What `evaluate` says of a trajectory; all SI.

    Attributes:
        objective: the criterion's value, larger is better; of a robust problem the one it asks for.
        lambda_min, lambda_max: extreme eigenvalues of the information in the criterion's scaling.
        singular_values: of W, descending, blocks together: of the paper's regressors unscaled, of sensors
            in units of the noise and scaled, with all nuisances eliminated.
        norm_y: size of the noise-free measurement at the nominal parameters, |W c|; of sensors in units of
            the noise.
        path_length: of the robot's origin [m].
        margins: of every limit, on a grid ten times finer than the samples; of a robust problem less what
            is kept in reserve.
        design_matrices: W of each block by name.
        information: F of each block by name, on the parameters the criterion judges, in its scaling.
        covariances: predicted, of each block's estimated parameters, SI; infinite variances where nothing
            is told; {} without noise.
        full_information: F of each block's estimated parameters, SI.
        alone: what F would tell of each, were all else known, (p,), SI.
        parameters: their names by block.
        poses: at the samples, (N + runs, states), run by run.
        path: on the fine grid, (10 N + runs, states).
    """

    objective: float
    lambda_min: float
    lambda_max: float
    singular_values: Array
    norm_y: float
    path_length: float
    margins: tuple[Margin, ...]
    design_matrices: Mapping[str, Array]
    information: Mapping[str, Array]
    covariances: Mapping[str, Array]
    full_information: Mapping[str, Array]
    alone: Mapping[str, Array]
    parameters: Mapping[str, tuple[str, ...]]
    poses: Array
    path: Array

    @property
    def smallest_singular_value(self) -> float:
        """s_min(W)."""
        return float(self.singular_values[-1])

    @property
    def condition_number(self) -> float:
        """cond(W) = s_max / s_min; infinite for a singular design."""
        largest, smallest = float(self.singular_values[0]), self.smallest_singular_value
        return largest / smallest if smallest > 0 else np.inf

    @property
    def log_determinant(self) -> float:
        """Log det of the information, all blocks together; minus infinity for a singular design."""
        signs, logs = zip(*(np.linalg.slogdet(matrix) for matrix in self.information.values()), strict=True)
        return float(np.sum(logs)) if min(signs) > 0 else -np.inf

    @property
    def standard_deviations(self) -> dict[str, float]:
        """Predicted standard deviation of each estimated parameter, SI; {} without noise."""
        return {
            name: float(size)
            for block, covariance in self.covariances.items()
            for name, size in zip(self.parameters[block], np.sqrt(np.diag(covariance)), strict=True)
        }

    @property
    def singular(self) -> bool:
        """Whether some combination of parameters is left undetermined, to rounding."""
        return self.lambda_min <= SINGULAR * self.lambda_max

    @property
    def feasible(self) -> bool:
        """Whether every limit is kept."""
        return all(margin.kept for margin in self.margins)

    @property
    def violations(self) -> dict[str, float]:
        """Amount by which each limit that is not kept is exceeded, in its SI unit."""
        return {margin.name: margin.violation for margin in self.margins if not margin.kept}


def evaluate(problem: Problem, trajectory: Trajectory) -> Evaluation:
    """Score any trajectory by a problem's measurement, criterion and limits.

    The trajectory keeps its own duration and samples; where it breaks the study's duration, start or
    rest, that is a violation like any other.

    Raises:
        ValueError: inputs or states that do not match the robot's, another number of runs.
        NotFinite: a drive, or what is measured of it, that is not finite; says what, and when.
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
    # Every run by itself, both its ends included.
    fine = [(one, np.linspace(0.0, one.duration, FINE * one.samples + 1)) for one in trajectory.each]
    values = np.concatenate([one.inputs_at(times) for one, times in fine])
    rates = np.concatenate([one.rates_at(times) for one, times in fine])
    jerks = np.concatenate([one.jerks_at(times) for one, times in fine])
    scorer = _scorer(problem, trajectory.samples, trajectory.runs, len(rates), len(jerks))
    return scorer.evaluation(trajectory, values, rates, jerks)


def parameter_table(problem: Problem) -> list[dict[str, Any]]:
    """The estimated parameters: name, nominal value, SI unit, the block that tells it, its noise, and
    whether the criterion judges it.
    """
    return [
        {
            "name": name,
            "nominal": float(nominal),
            "unit": unit,
            "block": one.block.name,
            "noise": one.block.noise,
            "judged": name in one.judged,
        }
        for one in problem.any_estimations
        for name, nominal, unit in zip(one.parameters, one.nominal, one.units, strict=True)
    ]


def input_table(problem: Problem) -> list[dict[str, Any]]:
    """The robot's inputs: name, quantity, SI unit."""
    return [
        {"name": entry.name, "quantity": entry.quantity, "unit": entry.unit} for entry in problem.model.inputs
    ]


def nuisance_table(problem: Problem) -> list[dict[str, Any]]:
    """What is estimated along: name, SI unit, the block, and the deviation known beforehand (or None)."""
    return [
        {"name": entry.name, "unit": entry.unit, "block": one.block.name, "deviation": entry.deviation}
        for one in problem.any_estimations
        for entry in one.block.nuisances
    ]


class _Scorer:
    """The compiled functions that score trajectories of one number of samples."""

    def __init__(self, problem: Problem, samples: int, runs: int, rates: int, jerks: int) -> None:
        model = problem.robot
        symbols: list[Any] = [
            ca.MX.sym("inputs", samples, len(model.inputs)),
            ca.MX.sym("start", runs, len(model.states)),
            ca.MX.sym("parameters", len(model.parameters)),
            ca.MX.sym("period"),
            ca.MX.sym("values", FINE * samples + runs, len(model.inputs)),
            ca.MX.sym("rates", rates, len(model.inputs)),
            ca.MX.sym("jerks", jerks, len(model.inputs)),
        ]
        names = ("inputs", "start", "parameters", "period", "input_values", "input_rates", "input_jerks")
        arguments = dict(zip(names, symbols, strict=True))
        drive = roll_out(
            model,
            problem.design.integration,
            refine=FINE,
            runs=runs,
            motion_inputs=arguments["input_values"],
            **arguments,
        )
        self.problem = problem
        self.estimations = problem.estimations(drive)
        self.rows: list[Rows] = problem.limit_rows(drive)
        groups = [
            [drive.path_length(), drive.poses, drive.path],
            [one.block.design_matrix for one in self.estimations],
            [one.block.response for one in self.estimations],
            [one.matrix for one in self.estimations],
            [one.full for one in self.estimations],
            [one.alone for one in self.estimations],
            [rows.expression for rows in self.rows],
        ]
        self._edges = np.cumsum([0, *map(len, groups)])
        outputs = [output for group in groups for output in group]
        self.function = ca.Function("score", symbols, outputs)
        self._symbols = symbols[:4]

    @cached_property
    def _judged(self) -> ca.Function:
        # Of any robot; only where others than the nominal one count.
        return ca.Function("judged", self._symbols, [one.matrix for one in self.estimations])

    def objective(self, trajectory: Trajectory, matrices: Sequence[Array]) -> float:
        """The criterion of the nominal robot's information, or of all robots that count."""
        problem, values = self.problem, []
        if problem.robust is None or problem.robust.objective == "nominal":
            return float(problem.objective.value(matrices))
        for parameters, shift in problem.judged_robots:
            found = self._judged.call(
                [trajectory.inputs, trajectory.starts + shift, parameters, trajectory.period]
            )
            values.append(problem.objective.value([np.array(matrix) for matrix in found]))
        return float(problem.together(values))

    def evaluation(self, trajectory: Trajectory, values: Array, rates: Array, jerks: Array) -> Evaluation:
        problem, drive = self.problem, trajectory
        results = self.function(
            drive.inputs, drive.starts, problem.robot.nominal, drive.period, values, rates, jerks
        )
        arrays = [np.array(result) for result in results]
        groups = [arrays[first:last] for first, last in pairwise(self._edges)]
        (length, poses, path), designs, responses, matrices, full, alone, limits = groups
        require_finite(problem, drive, path, responses, designs, [*matrices, *full])
        eigenvalues = [np.maximum(np.linalg.eigvalsh(matrix), 0.0) for matrix in matrices]
        singular = [
            np.linalg.svd(design, compute_uv=False) if one.block.raw else np.sqrt(values)
            for one, design, values in zip(self.estimations, designs, eigenvalues, strict=True)
        ]
        names = [one.block.name for one in self.estimations]
        margins = [
            _margin(limit.name, rows, row_values.ravel())
            for limit, rows, row_values in zip(problem.limits, self.rows, limits, strict=True)
        ]
        return Evaluation(
            objective=self.objective(trajectory, matrices),
            lambda_min=float(np.min(np.concatenate(eigenvalues))),
            lambda_max=float(np.max(np.concatenate(eigenvalues))),
            singular_values=np.sort(np.concatenate(singular))[::-1],
            norm_y=float(np.linalg.norm(np.concatenate(responses))),
            path_length=float(length.item()),
            margins=(*margins, *_conditions(problem, trajectory)),
            design_matrices=dict(zip(names, designs, strict=True)),
            information=dict(zip(names, matrices, strict=True)),
            covariances={
                one.block.name: _covariance(matrix, single.ravel())
                for one, matrix, single in zip(self.estimations, full, alone, strict=True)
                if one.noisy
            },
            full_information=dict(zip(names, full, strict=True)),
            alone={name: single.ravel() for name, single in zip(names, alone, strict=True)},
            parameters={one.block.name: one.parameters for one in self.estimations},
            poses=poses,
            path=path,
        )


@lru_cache(maxsize=64)
def _scorer(problem: Problem, samples: int, runs: int, rates: int, jerks: int) -> _Scorer:
    return _Scorer(problem, samples, runs, rates, jerks)


def _covariance(matrix: Array, alone: Array) -> Array:
    # F^-1, with infinite variances for parameters that a direction without information touches.
    told, eigenvalues, vectors, scale = told_directions(matrix, alone)
    inverse = np.where(told, 1.0 / np.where(told, eigenvalues, 1.0), 0.0)
    covariance = (vectors * inverse) @ vectors.T / np.outer(scale, scale)
    untold = (np.abs(vectors[:, ~told]) > np.sqrt(ROUNDING)).any(axis=1)
    covariance[untold, :] = covariance[:, untold] = np.nan
    covariance[untold, untold] = np.inf
    return np.asarray(covariance)


def told_directions(matrix: Array, alone: Array) -> tuple[npt.NDArray[np.bool_], Array, Array, Array]:
    """Which combinations of parameters an information matrix tells, to rounding.

    Args:
        matrix: F (p, p).
        alone: what it would tell of each parameter, were all else known, (p,): the measure of rounding.

    Returns:
        Whether each is told, its eigenvalue, the combinations (columns) in units of the last: (p,).
    """
    scale = np.sqrt(np.where(alone > 0, alone, 1.0))
    eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    return eigenvalues > ROUNDING, eigenvalues, vectors, scale


def _margin(name: str, rows: Rows, values: Array) -> Margin:
    if np.isnan(values).any():
        raise NotFinite(Flaw(("limits", name), "not a number somewhere along the drive"))
    # Nothing to keep to, as with a limit of changes on a drive of one sample, is kept.
    distance = np.min([rows.upper - values, values - rows.lower], initial=np.inf)
    return Margin(name, float(distance), rows.size, rows.unit)


def _conditions(problem: Problem, trajectory: Trajectory) -> list[Margin]:
    # What the design space itself asks; a solver's design keeps it by construction, a user's path may not.
    space, model = problem.design, problem.model
    spare = space.whole_duration - trajectory.duration
    margins = [Margin("duration", spare, space.whole_duration, "s")]
    if problem.fixed_starts is not None:
        offset = np.abs(trajectory.starts - problem.fixed_starts).max()
        margins.append(Margin("start", -float(offset), 1.0, "m or rad"))
    if space.rest_to_rest:
        ends = np.concatenate([one.inputs_at(np.array([0.0, one.duration])) for one in trajectory.each])
        size = float(np.abs(problem.input_bounds).max())
        margins.append(Margin("rest_to_rest", -float(np.abs(ends).max()), size, model.inputs[0].unit))
    return margins
