"""A trajectory taken apart: what each of its readings says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from oed.foundation.arguments import typed
from oed.foundation.arrays import Array
from oed.foundation.errors import ProblemError
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import resolved
from oed.kernel.measurement.measurement import process_noise_of
from oed.kernel.measurement.square_root import SquareRoot, rounding_of
from oed.kernel.parts import Parts, laid_out, rows_of
from oed.kernel.problem import Problem
from oed.kernel.scorer import jacobians


@typed
def parts_of(problem: Problem, trajectory: Trajectory) -> Parts:
    """Return the information in every reading of a trajectory, whatever weights they have in it.

    Raises:
        ProblemError: a measurement whose readings do not add up: of regressions, or correlated.
        ValueError, NotFinite: as `evaluate` does.
    """
    sensors = problem.measurement.joint_sensors
    alone = all(one.joint_whitening is None for one in sensors) and process_noise_of(sensors) is None
    if not sensors or not alone:
        text = "its readings do not add up one by one: weights need sensors with independent readings"
        raise ProblemError.about(("measurement", "kind"), text)
    whole, bare = replace(trajectory, weights=None), problem
    if problem.system.integrates and problem.selection is not None:
        bare = replace(problem, selection=None)
    (one,), (jacobian,) = problem.any_estimations, jacobians(resolved(bare, whole), whole)
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
    given = sensors, problem.system, trajectory.samples // trajectory.runs, trajectory.runs
    every, rounding = _disentangled(np.vstack([rows, SquareRoot.of_matrix(known).rows]), judged)
    return replace(
        laid_out(*given, trajectory.period),
        rows=every[: len(rows)],
        places=rows_of(*given),
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
    rounding, others = rounding_of(every), every[:, judged:]
    seen = np.count_nonzero(others, axis=0)
    basis, lengths = np.zeros((len(every), 0)), list[float]()
    for place in np.argsort(seen, kind="stable"):
        if seen[place]:
            rest = _beside(others[:, place] / np.linalg.norm(others[:, place]), basis)
            length = float(np.linalg.norm(rest))
            if length > rounding:
                # Twice is enough [Giraud, Langou, Rozloznik, The loss of orthogonality in the Gram-Schmidt
                # orthogonalization process, 2005].
                rest = _beside(rest / length, basis)
                basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
                lengths.append(length)
    wanted = every[:, :judged]
    own = np.linalg.norm(wanted, axis=0)
    taken = np.linalg.norm(basis.T @ wanted / np.array(lengths)[:, None], axis=0)
    left = _beside(_beside(wanted, basis), basis)
    share = np.linalg.norm(left, axis=0)
    lost = share <= rounding * (own + taken)
    left[:, lost], share[lost] = 0.0, 1.0
    unsure = np.where(lost, rounding, rounding * (own + taken) / share)
    return np.hstack([left, basis]), np.concatenate([unsure, np.full(len(lengths), rounding)])


def _beside(columns: Array, basis: Array) -> Array:
    # What an orthonormal basis leaves of columns.
    return np.asarray(columns - basis @ (basis.T @ columns))
