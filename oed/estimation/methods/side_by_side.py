"""Least squares of many simulated experiments of one drive at once.

They take the full Gauss-Newton steps that `LeastSquares` takes of one alone, and end where it ends: a step
is one call of what predicts the readings, and few of linear algebra, for all of them. Those of which a step
has to be made smaller are left to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from oed.estimation.methods.gauss_newton import FAR, SURE, WORSE, LeastSquares
from oed.estimation.prediction.drive_readings import DriveReadings
from oed.estimation.prediction.layout import without_turns
from oed.foundation.arrays import Array, Bools

STEPS = 12
"""Steps that the experiments take together at most; what takes more goes on alone."""
NUMBERS = 100_000
"""Derivatives at once, which a processor has at hand: of more experiments each takes longer."""


class _At(NamedTuple):
    # Where experiments are: values (R, q), their misfits (R,), rows (R, k, q), residuals of these (R, k).
    values: Array
    misfit: Array
    rows: Array
    residuals: Array


@dataclass(frozen=True)
class SideBySide:
    """Searches for the least squares of experiments.

    Attributes:
        search: as of one experiment, with a linear loss.
        drive: what is read in all of them.
    """

    search: LeastSquares
    drive: DriveReadings

    @property
    def most(self) -> int:
        """Experiments at once."""
        return max(NUMBERS // max(self.drive.order.size * len(self.search.scale), 1), 1)

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def solved(self, readings: Array, known: Array, begin: Array) -> tuple[Array, Bools]:
        """The least squares (R, q), and which searches have arrived (R,).

        Args:
            readings: run by run, (R, runs, M).
            known: values that knowledge from before is about, (R, q).
            begin: unknowns to begin at, (q,).
        """
        at = self._at(np.tile(begin, (len(readings), 1)), readings, known)
        arrived, left = np.zeros((2, len(readings)), dtype=bool)
        for _ in range(STEPS):
            steps, lengths = _steps(at)
            there = self._at(at.values + steps, readings, known)
            smooth = np.isfinite(there.rows).all(axis=(1, 2)) & np.isfinite(there.misfit)
            better = smooth & (there.misfit <= at.misfit * (1 + WORSE)) & (lengths < FAR)
            going = ~arrived & ~left
            left |= going & ~better
            moved = going & better
            close = (np.abs(steps) / self.search.scale).max(axis=1, initial=0.0) < self.search.close
            arrived |= moved & (close | (lengths < SURE))
            if not moved.all():
                pairs = zip(there, at, strict=True)
                there = _At(*(np.where(_wide(moved, new), new, old) for new, old in pairs))
            at = there
            if (arrived | left).all():
                break
        return at.values, arrived

    def _at(self, values: Array, readings: Array, known: Array) -> _At:
        found, slopes = self.drive.side_by_side(values)
        left = without_turns(readings[..., None] - found, self.drive.wrapping)
        every = np.concatenate([left[..., None], slopes], axis=-1).reshape(
            len(values), self.drive.order.size, -1
        )
        white = self._whitened(every)
        # What is known from before, below these as if it had been read.
        before = (known - values) @ self.search.root.T
        residuals = np.hstack([white[..., 0], before])
        root = np.broadcast_to(self.search.root, (len(values), *self.search.root.shape))
        rows = np.concatenate([white[..., 1:], root], axis=1)
        return _At(values, np.einsum("rk,rk->r", residuals, residuals), rows, residuals)

    def _whitened(self, every: Array) -> Array:
        # Columns of experiments, (R, M, c), in units of the noise.
        many, count, columns = every.shape
        beside = every.transpose(1, 0, 2).reshape(count, many * columns)
        return np.asarray(self.drive.whitener @ beside).reshape(count, many, columns).transpose(1, 0, 2)


def _wide(chosen: Bools, values: Array) -> Bools:
    return chosen.reshape(-1, *(1,) * (values.ndim - 1))


def _steps(at: _At) -> tuple[Array, Array]:
    # Full steps (R, q), and their lengths in standard errors, (R,); those that cannot be found are infinite.
    right = np.einsum("rkq,rk->rq", at.rows, at.residuals)
    sizes = np.linalg.norm(at.rows, axis=1)
    usable = np.isfinite(at.rows).all(axis=(1, 2)) & (sizes > 0).all(axis=1)
    rows = np.where(_wide(usable, at.rows), at.rows / sizes[:, None, :], 0.0)
    triangles = np.asarray(np.linalg.qr(rows, mode="r"))
    solvable = usable & (np.abs(np.diagonal(triangles, axis1=1, axis2=2)) > 0).all(axis=1)
    triangles = np.where(_wide(solvable, triangles), triangles, np.eye(rows.shape[-1]))
    half = np.linalg.solve(triangles.transpose(0, 2, 1), (right / sizes)[..., None])
    steps = np.linalg.solve(triangles, half)[..., 0] / sizes
    lengths = np.linalg.norm(half[..., 0], axis=1)
    return np.where(solvable[:, None], steps, np.inf), np.where(solvable, lengths, np.inf)
