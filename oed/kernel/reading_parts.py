"""Information in each reading of a trajectory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.errors import ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import resolved
from oed.kernel.measurement.square_root import SquareRoot, rounding_of
from oed.kernel.parts import Parts, taken_of
from oed.kernel.problem import Problem
from oed.kernel.scorer import jacobians


@typed
def parts_of(problem: Problem, trajectory: Trajectory) -> Parts:
    """Return the information in every reading of a trajectory, whatever weights they have in it.

    The weights decide by which integration steps alone: by those that `evaluate` scores the trajectory with.

    Raises:
        ProblemError: a measurement whose readings do not add up: of regressions, or correlated.
        ValueError, NotFinite: see `evaluate`.
    """
    sensors = problem.sensors
    alone = all(sensor.joint_whitening is None for sensor in sensors) and problem.process_noise is None
    if not sensors or not alone:
        text = "its readings do not add up one by one: weights need sensors with independent readings"
        raise ProblemError.about(("measurement", "kind"), text)
    unselected = problem.unselected if trajectory.weights is None else problem
    refined, unweighted = resolved(unselected, trajectory), replace(trajectory, weights=None)
    (estimation,), (jacobian,) = problem.any_estimations, jacobians(refined, unweighted)
    block, count = estimation.block, len(estimation.parameters)
    places = [block.parameters.index(name) for name in estimation.parameters]
    nuisances = range(len(block.parameters), jacobian.shape[1])
    judged = len(estimation.judged)
    scales = np.concatenate([estimation.scales, np.ones(count - judged + len(nuisances))])
    rows = jacobian[:, [*places, *nuisances]] * scales
    prior = np.zeros((rows.shape[1],) * 2)
    if estimation.prior is not None:
        prior[:count, :count] = estimation.prior
    prior[np.diag_indices(len(prior))] += [0.0] * count + [
        0.0 if nuisance.deviation is None else nuisance.deviation**-2 for nuisance in block.nuisances
    ]
    prior *= np.outer(scales, scales)
    every, rounding = _disentangled(np.vstack([rows, SquareRoot.of_matrix(prior).rows]), judged)
    return replace(
        taken_of(sensors, problem.system, trajectory),
        rows=every[: len(rows)],
        known_rows=every[len(rows) :],
        judged=judged,
        rounding=rounding,
    )


def _disentangled(every: Array, judged: int) -> tuple[Array, Array]:
    # All rows (k, q), with the unknowns that are not judged in combinations that all rows together tell
    # apart, and from the judged ones: information on what is judged stays the same, and its squares keep the
    # digits that they lose of nearly dependent columns. Unknowns of one trial, such as its start, come first,
    # and have nothing to do with those of another: matrices of which most is 0 stay so. Of others that depend
    # on each other, such as two seen alike by every reading, what differs between them is left out. And what
    # may be rounding of every column now, as a share of it, (q,): as in `project_out`.
    rounding, nuisances = rounding_of(every), every[:, judged:]
    counts = np.count_nonzero(nuisances, axis=0)
    basis, lengths = np.zeros((len(every), 0)), list[float]()
    for place in np.argsort(counts, kind="stable"):
        if counts[place]:
            rest = _residual(nuisances[:, place] / np.linalg.norm(nuisances[:, place]), basis)
            length = float(np.linalg.norm(rest))
            if length > rounding:
                # Twice is enough [Giraud, Langou, Rozloznik, The loss of orthogonality in the Gram-Schmidt
                # orthogonalization process, 2005].
                rest = _residual(rest / length, basis)
                basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
                lengths.append(length)
    wanted = every[:, :judged]
    magnitudes = np.linalg.norm(wanted, axis=0)
    taken = np.linalg.norm(basis.T @ wanted / np.array(lengths)[:, None], axis=0)
    remaining = _residual(_residual(wanted, basis), basis)
    share = np.linalg.norm(remaining, axis=0)
    lost = share <= rounding * (magnitudes + taken)
    remaining[:, lost], share[lost] = 0.0, 1.0
    unsure = np.where(lost, rounding, rounding * (magnitudes + taken) / share)
    return np.hstack([remaining, basis]), np.concatenate([unsure, np.full(len(lengths), rounding)])


def _residual(columns: Array, basis: Array) -> Array:
    # What an orthonormal basis leaves of columns.
    return np.asarray(columns - basis @ (basis.T @ columns))
