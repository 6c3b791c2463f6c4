"""A trajectory taken apart: what each of its readings says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.errors import ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import jacobians
from oed.kernel.measurement.process_noise import process_noise_of
from oed.kernel.measurement.square_root import SquareRoot, rounding_of
from oed.kernel.parts import Parts, laid_out, rows_of
from oed.kernel.problem import Problem


@typed
def parts_of(problem: Problem, trajectory: Trajectory) -> Parts:
    """What every reading of a trajectory says, whatever weights they have in it.

    Raises:
        ProblemError: a measurement whose readings do not add up: of regressions, or correlated.
        ValueError, NotFinite: as `evaluate` does.
    """
    sensors = problem.measurement.joint_sensors
    alone = all(one.joint_whitening is None for one in sensors) and process_noise_of(sensors) is None
    if not sensors or not alone:
        text = "its readings do not add up one by one: weights need sensors with independent readings"
        raise ProblemError.about(("measurement", "kind"), text)
    (one,), (jacobian,) = problem.any_estimations, jacobians(problem, replace(trajectory, weights=None))
    block, count = one.block, len(one.parameters)
    own = [block.parameters.index(name) for name in one.parameters]
    nuisances = range(len(block.parameters), jacobian.shape[1])
    judged = len(one.judged)
    scales = np.concatenate([one.scales, np.ones(count - judged + len(nuisances))])
    rows = jacobian[:, [*own, *nuisances]] * scales
    known = np.zeros((rows.shape[1],) * 2)
    if one.prior is not None:
        known[:count, :count] = one.prior
    known[np.diag_indices(len(known))] += [0.0] * count + [
        0.0 if nuisance.deviation is None else nuisance.deviation**-2 for nuisance in block.nuisances
    ]
    known *= np.outer(scales, scales)
    rows, known = _disentangled(rows, known, judged)
    given = sensors, problem.system, trajectory.samples // trajectory.runs, trajectory.runs
    places = rows_of(*given)
    single = laid_out(*given, trajectory.period)
    matrices = np.zeros((len(single.readings), *known.shape))
    np.add.at(matrices, places, np.einsum("ra,rb->rab", rows, rows))
    return replace(single, matrices=matrices, known=known, judged=judged)


def _disentangled(rows: Array, known: Array, judged: int) -> tuple[Array, Array]:
    # Rows (k, q) and prior information (q, q) with the unknowns that are not judged in combinations of all
    # that all readings together tell apart, and from the judged ones: what is judged stays the same, and the
    # matrices keep the digits that squares of nearly dependent columns lose.
    prior = SquareRoot.of_matrix(known).rows
    every = np.vstack([rows, prior])
    there = (every[:, judged:] != 0).astype(float)
    if judged == rows.shape[1] or not np.all(there.T @ there):
        # Unknowns of one trial, such as its start, have nothing to do with those of another: many matrices
        # of which most is 0 are to stay so.
        return rows, known
    if not SquareRoot.of_rows(every).leading(judged).complete:
        return rows, known
    # Of others that depend on each other, such as two that every reading sees alike, what tells them apart is
    # left out: nothing that is judged depends on it.
    sizes = np.linalg.norm(every[:, judged:], axis=0)
    basis, lengths, combinations = np.linalg.svd(every[:, judged:] / sizes, full_matrices=False)
    known_apart = lengths > rounding_of(every)
    mixed = combinations[known_apart].T / lengths[known_apart] / sizes[:, None]
    across = basis[:, known_apart].T @ every[:, :judged]

    def moved(one: Array) -> Array:
        rest = one[:, judged:] @ mixed
        return np.hstack([one[:, :judged] - rest @ across, rest])

    before = moved(prior)
    return moved(rows), before.T @ before
