"""How noisy the motions between windows' ends are: poses shared by neighbours, clocks' jitter, drift.

The covariance of all motions is block-tridiagonal: an error of the pose between two windows makes one of them
longer and the other shorter, drift is each window's own. It is kept as a band.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from oed.estimation.methods import bands
from oed.estimation.methods.bands import banded, factor, product, traces, weighted, whitened
from oed.estimation.methods.windows import TINY, end_rates
from oed.foundation.arrays import Array, Bools
from oed.kernel.measurement.square_root import SquareRoot

PARTS = ("position", "heading", "timing", "ahead", "sideways", "turn_by_path", "turn_by_turning")
"""Parts of the variance: of a pose [m^2], [rad^2] and of when it was taken [s^2]; of drift ahead and sideways
per path [m^2/m], of its turn per path [rad^2/m] and per turning [rad^2/rad]."""
OF_POSES, TIMING = 3, 2
"""How many of them are the poses', and which of those grows with speed and yaw rate."""
TURNS = (1, 5, 6)
"""Those that show in turns most of all."""
FIRST = 0.3
"""Share of the residuals' variance that every part is thought to have at first."""
ENOUGH = 1e-6
"""Relative change of the likelihood's logarithm at which its search has arrived."""
SPREAD = (-14.0, 7.0)
"""How far the logarithm of a part may be from that of the residuals' variance."""
STEP = 0.05
"""Of difference quotients by logarithms of variances."""


@dataclass(frozen=True)
class Course:
    """What of windows their noise depends on.

    Attributes:
        path: predicted poses, seen from the first, (S, n + 1, 3).
        steps: time between them, (S, n) [s].
        linked: whether a window begins where the one before it ends, (S - 1,).
        counts: of how many poses the first and the last one are the mean, (S, 2) or 1.
        sensor_heading: of the sensor on the robot [rad]: drift is ahead and sideways of the robot.
    """

    path: Array
    steps: Array
    linked: Bools
    counts: Array | float = 1.0
    sensor_heading: float = 0.0

    def of_poses(self, variances: Array) -> Array:
        """Covariance of the motions, as a band, by noise of the poses at their ends.

        Args:
            variances: (S, 2, 3, 3), each along its own heading.
        """
        before, after = effects_of_ends(self.path[:, -1])
        own = before @ variances[:, 0] @ _turned(before) + after @ variances[:, 1] @ _turned(after)
        shared = before[1:] @ variances[:-1, 1] @ _turned(after[:-1])
        return banded(own, shared * self.linked[:, None, None])

    @property
    def parts(self) -> Array:
        """Covariance of the motions, as a band, by every one of `PARTS` of variance 1, (parts, 6, 3 S)."""
        rates, shares = self._shared_rates, np.broadcast_to(1.0 / self.counts, (len(self.path), 2))
        each = shares[..., None, None]
        timing = rates[..., :, None] * rates[..., None, :]
        poses = [each * np.diag([1.0, 1.0, 0.0]), each * np.diag([0.0, 0.0, 1.0]), each * timing]
        return np.stack([*map(self.of_poses, poses), *map(banded, self._drifts)])

    @property
    def _shared_rates(self) -> Array:
        # Both windows see the pose between them at one velocity.
        rates = end_rates(self.path, self.steps)
        mean = (rates[:-1, 1] + rates[1:, 0]) / 2
        rates[:-1, 1] = np.where(self.linked[:, None], mean, rates[:-1, 1])
        rates[1:, 0] = np.where(self.linked[:, None], mean, rates[1:, 0])
        return rates

    @property
    def _drifts(self) -> list[Array]:
        # Errors of the steps, independent of each other, carried along to the window's end.
        moves = np.diff(self.path, axis=1)
        heading = self.path[:, :-1, 2] + moves[..., 2] / 2 - self.sensor_heading
        rest = self.path[:, -1:] - (self.path[:, :-1] + moves / 2)
        cosine, sine, none = np.cos(heading), np.sin(heading), np.zeros(heading.shape)
        ahead = np.stack([cosine, sine, none], axis=-1)
        left = np.stack([-sine, cosine, none], axis=-1)
        turn = np.stack([-rest[..., 1], rest[..., 0], none + 1], axis=-1)
        length, turning = np.hypot(moves[..., 0], moves[..., 1]), np.abs(moves[..., 2])
        pairs = ((length, ahead), (length, left), (length, turn), (turning, turn))
        return [np.einsum("sk,ski,skj->sij", size, way, way) for size, way in pairs]


@dataclass(frozen=True)
class Likelihood:
    """Restricted likelihood of variances: of what residuals say that no unknowns could explain.

    [Patterson, Thompson: Recovery of inter-block information when block sizes are unequal, 1971]

    Attributes:
        parts: bands by parts of the variance, (parts, 6, 3 S).
        fixed: band of the noise that is known, (6, 3 S).
        rows: residuals, then their derivatives by the unknowns in units of the unknowns' size, (3 S, 1 + q).
        known: information on those from before, (q, q), and what it pulls with, (q,).
        prior: means and standard deviations of the variances' logarithms, thought normal, (parts,) each; None
            of variances of which nothing is known.
    """

    parts: Array
    fixed: Array
    rows: Array
    known: tuple[Array, Array]
    prior: tuple[Array, Array] | None = None

    def greatest(self, first: Array | None = None) -> Array:
        """The variances (parts,) that make it greatest; the search may begin with those given."""
        if first is None and self.prior is not None:
            first = np.exp(self.prior[0])
        unit = self.units
        identified = unit > 0
        if not identified.any():
            return unit
        begin = np.full(len(unit), FIRST) if first is None else first / np.where(identified, unit, 1.0)
        start = np.clip(np.log(np.maximum(begin[identified], np.exp(SPREAD[0]))), *SPREAD)

        def surprise(logs: Array) -> tuple[float, Array]:
            variances = np.zeros(len(unit))
            variances[identified] = unit[identified] * np.exp(logs)
            value, slope = self.surprise(variances)
            return value, (slope * variances)[identified]

        found = scipy.optimize.minimize(
            surprise,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=[SPREAD] * len(start),
            options={"ftol": ENOUGH},
        )
        unit[identified] *= np.exp(found.x)
        return unit

    def surprise(self, variances: Array) -> tuple[float, Array]:
        """Twice its negative logarithm, but for a constant, and the derivatives by the variances; of those
        that are not 0 the prior's is counted in.
        """
        root = factor(self.covariance(variances))
        white = whitened(root, self.rows)
        residuals, slopes = white[:, 0], white[:, 1:]
        information, pull = self.known
        inverse, size = _inverse(slopes.T @ slopes + information)
        right = slopes.T @ residuals + pull
        value = residuals @ residuals - right @ inverse @ right + 2 * np.log(root[0]).sum() + size
        # What a change of the covariance does is what it makes of this.
        back = weighted(root, np.column_stack([residuals - slopes @ (inverse @ right), slopes]))
        left = np.column_stack([back[:, 0], back[:, 1:] @ inverse])
        slope = traces(self.parts, bands.inverse(root) - product(left, back))
        if self.prior is None:
            return float(value), slope
        mean, deviation = self.prior
        there = variances > 0
        off = np.log(variances, out=mean.copy(), where=there) - mean
        pull = 2 * off / deviation**2
        slope += np.divide(pull, variances, out=np.zeros_like(pull), where=there)
        return float(value + ((off / deviation) ** 2).sum()), slope

    def spread(self, variances: Array) -> Array:
        """Covariance of the logarithms of the variances, (parts, parts), of those that are 0 by the prior:
        the inverse of half the curvature of what is least, by differences of its slope.
        """
        assert self.prior is not None
        mean, deviation = self.prior
        logs = np.log(variances, out=mean.copy(), where=variances > 0)

        def slope(at: Array) -> Array:
            return self.surprise(np.exp(at))[1] * np.exp(at)

        units = STEP * np.eye(len(logs))
        half = np.array([slope(logs + unit) - slope(logs - unit) for unit in units]) / (4 * STEP)
        values, vectors = np.linalg.eigh((half + half.T) / 2)
        # Nothing is known less well than the prior has it.
        values = np.maximum(values, 1 / deviation.max() ** 2)
        return np.asarray((vectors / values) @ vectors.T)

    def covariance(self, variances: Array) -> Array:
        """Band (6, 3 S) of the motions' covariance."""
        return np.asarray(self.fixed + np.tensordot(variances, self.parts, axes=1))

    @property
    def units(self) -> Array:
        """Variances (parts,) by which every part alone would make up the residuals; 0 where it shows in no
        window.
        """
        squares = self.rows[:, 0].reshape(-1, 3) ** 2
        sizes = squares[:, :2].mean(), squares[:, 2].mean()
        found = np.zeros(len(self.parts))
        for index, part in enumerate(self.parts):
            turns = index + len(PARTS) - len(self.parts) in TURNS
            own = part[0].reshape(-1, 3)[:, 2 if turns else slice(2)].mean()
            if own > 0:
                found[index] = max(sizes[turns], TINY**2) / own
        return found


def _inverse(normal: Array) -> tuple[Array, float]:
    # And the logarithm of the determinant, both of what is identifiable: the rest has no part in this.
    root = SquareRoot.of_matrix(normal)
    identified = root.factor[:, root.identifiable]
    return identified @ identified.T, -float(np.linalg.slogdet(identified.T @ identified)[1])


def drift_in_words(rates: Array) -> str:
    """Variances (4,) of drift, as the last of `PARTS`, in words as standard deviations."""
    ahead, sideways, by_path, by_turning = np.sqrt(rates)
    by_path, by_turning = np.degrees([by_path, by_turning])
    return (
        f"{1e3 * ahead:.1f} mm ahead, {1e3 * sideways:.1f} mm sideways and {by_path:.2f} deg after 1 m, "
        f"{by_turning:.2f} deg after 1 rad of turning; it grows with the root of either"
    )


def effects_of_ends(motion: Array) -> tuple[Array, Array]:
    """What errors of the first and the last pose, each along its own heading, do to motions (S, 3), each
    (S, 3, 3).
    """
    ahead, left, turn = motion.T
    before = np.broadcast_to(-np.eye(3), (len(motion), 3, 3)).copy()
    before[:, 0, 2], before[:, 1, 2] = left, -ahead
    after = np.broadcast_to(np.eye(3), (len(motion), 3, 3)).copy()
    after[:, 0, 0] = after[:, 1, 1] = np.cos(turn)
    after[:, 0, 1], after[:, 1, 0] = -np.sin(turn), np.sin(turn)
    return before, after


def _turned(matrices: Array) -> Array:
    return matrices.transpose(0, 2, 1)
