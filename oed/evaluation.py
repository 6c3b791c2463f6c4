"""`evaluate`: the one scorer of trajectories.

Every number that anything reports about a trajectory (solvers, baselines, bounds, reports) comes from here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from oed.limits.limit import Rows
from oed.measurements.measurement import Block
from oed.problem import Problem
from oed.rollout import FINE, roll_out
from oed.trajectory import Trajectory

Array = npt.NDArray[np.float64]

TOLERANCE = 1e-3
"""A limit counts as kept when it is exceeded by at most this share of its size, and as active within it."""

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
        objective: the criterion's value, larger is better.
        lambda_min, lambda_max: extreme eigenvalues of the information in the criterion's scaling.
        singular_values: of W, unscaled, descending (blocks together).
        norm_y: |W c| at the nominal parameters: the size of the noise-free measurement.
        path_length: of the robot's origin [m].
        margins: of every limit, on a grid ten times finer than the samples.
        design_matrices: W of each block by name.
        information: F of each block by name, in the criterion's scaling.
        standard_deviations: predicted, of each parameter, sqrt(diag(sigma^2 (W'W)^-1)); {} without noise.
        poses: at the samples, (N + 1, states).
        path: on the fine grid, (10 N + 1, states).
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
    standard_deviations: Mapping[str, float]
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
        ValueError: inputs that do not match the robot's.
    """
    expected = len(problem.model.inputs)
    if trajectory.coefficients.shape[1] != expected:
        names = ", ".join(problem.model.input_names)
        raise ValueError(f"expected {expected} inputs ({names}), got {trajectory.coefficients.shape[1]}")
    fine_times = np.linspace(0.0, trajectory.duration, FINE * trajectory.samples + 1)
    rates = trajectory.rates_at(fine_times)
    scorer = _scorer(problem, trajectory.samples, len(rates))
    return scorer.evaluation(trajectory, trajectory.inputs_at(fine_times), rates)


def parameter_table(problem: Problem) -> list[dict[str, Any]]:
    """The estimated parameters: name, nominal value, SI unit, the block that tells it, its noise."""
    return [
        {
            "name": name,
            "nominal": float(nominal),
            "unit": block.unit,
            "block": block.name,
            "noise": block.noise,
        }
        for block in problem.parameter_blocks()
        for name, nominal in zip(block.parameters, block.nominal, strict=True)
    ]


class _Scorer:
    """The compiled functions that score trajectories of one number of samples."""

    def __init__(self, problem: Problem, samples: int, rates: int) -> None:
        model = problem.model
        symbols: list[Any] = [
            ca.MX.sym("inputs", samples, len(model.inputs)),
            ca.MX.sym("start", len(model.states)),
            ca.MX.sym("parameters", len(model.parameters)),
            ca.MX.sym("period"),
            ca.MX.sym("values", FINE * samples + 1, len(model.inputs)),
            ca.MX.sym("rates", rates, len(model.inputs)),
        ]
        names = ("inputs", "start", "parameters", "period", "input_values", "input_rates")
        arguments = dict(zip(names, symbols, strict=True))
        drive = roll_out(model, problem.design.integration, refine=FINE, **arguments)
        self.problem = problem
        self.blocks, matrices = problem.matrices(drive)
        self.rows: list[Rows] = [limit.rows(drive) for limit in problem.limits]
        designs = [block.design_matrix for block in self.blocks]
        limits = [rows.expression for rows in self.rows]
        general = [drive.path_length(), drive.poses, drive.path]
        outputs: list[Any] = [*general, *designs, *matrices, *limits]
        self.function = ca.Function("score", symbols, outputs)

    def evaluation(self, trajectory: Trajectory, values: Array, rates: Array) -> Evaluation:
        problem, count = self.problem, len(self.blocks)
        nominal = problem.model.nominal
        results = self.function(
            trajectory.inputs, trajectory.start, nominal, trajectory.period, values, rates
        )
        length, poses, path, *rest = (np.array(result) for result in results)
        designs, matrices, limits = rest[:count], rest[count : 2 * count], rest[2 * count :]
        eigenvalues = np.maximum(np.concatenate([np.linalg.eigvalsh(matrix) for matrix in matrices]), 0.0)
        singular = np.concatenate([np.linalg.svd(design, compute_uv=False) for design in designs])
        names = [block.name for block in self.blocks]
        margins = [
            _margin(limit.name, rows, row_values.ravel())
            for limit, rows, row_values in zip(problem.limits, self.rows, limits, strict=True)
        ]
        return Evaluation(
            objective=float(problem.criterion.value(matrices)),
            lambda_min=float(eigenvalues.min()),
            lambda_max=float(eigenvalues.max()),
            singular_values=np.sort(singular)[::-1],
            norm_y=_norm_y(self.blocks, designs),
            path_length=float(length.item()),
            margins=(*margins, *_conditions(problem, trajectory)),
            design_matrices=dict(zip(names, designs, strict=True)),
            information=dict(zip(names, matrices, strict=True)),
            standard_deviations=_standard_deviations(self.blocks, designs),
            poses=poses,
            path=path,
        )


@lru_cache(maxsize=64)
def _scorer(problem: Problem, samples: int, rates: int) -> _Scorer:
    return _Scorer(problem, samples, rates)


def _norm_y(blocks: tuple[Block, ...], designs: list[Array]) -> float:
    responses = [design @ block.nominal for block, design in zip(blocks, designs, strict=True)]
    return float(np.linalg.norm(np.concatenate(responses)))


def _standard_deviations(blocks: tuple[Block, ...], designs: list[Array]) -> dict[str, float]:
    # sqrt(diag(sigma^2 (W'W)^-1)) from the singular values of W, infinite where W is singular [Choi, eq. 18].
    deviations: dict[str, float] = {}
    for block, design in zip(blocks, designs, strict=True):
        if block.noise is None:
            continue
        # W itself for many rows, padded for too few: the right vectors span all parameters either way.
        few = max(0, len(block.parameters) - len(design))
        _, singular, right = np.linalg.svd(np.pad(design, ((0, few), (0, 0))), full_matrices=False)
        # A singular value within rounding of 0 determines nothing.
        rounding = np.finfo(float).eps * max(design.shape) * singular[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.where(singular > rounding, 1.0 / singular, np.inf)
            shares = np.where(np.abs(right) <= np.finfo(float).eps, 0.0, (right * inverse[:, None]) ** 2)
        sizes = block.noise * np.sqrt(shares.sum(axis=0))
        deviations.update(zip(block.parameters, map(float, sizes), strict=True))
    return deviations


def _margin(name: str, rows: Rows, values: Array) -> Margin:
    distance = min(np.min(rows.upper - values), np.min(values - rows.lower))
    return Margin(name, float(distance), rows.size, rows.unit)


def _conditions(problem: Problem, trajectory: Trajectory) -> list[Margin]:
    # What the design space itself asks; a solver's design keeps it by construction, a user's path may not.
    space, model = problem.design, problem.model
    spare = space.duration - trajectory.duration
    margins = [Margin("duration", spare, space.duration, "s")]
    if space.fixed_start is not None:
        offset = np.abs(trajectory.start[:3] - space.fixed_start).max()
        margins.append(Margin("start", -float(offset), 1.0, "m or rad"))
    if space.rest_to_rest:
        ends = trajectory.inputs_at(np.array([0.0, trajectory.duration]))
        size = float(np.abs(problem.input_bounds).max())
        margins.append(Margin("rest_to_rest", -float(np.abs(ends).max()), size, model.inputs[0].unit))
    return margins
