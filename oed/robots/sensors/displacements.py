"""The paper's regression: displacements and turns of segments of the drive against wheel angles."""

from __future__ import annotations

from typing import Annotated, Literal

import casadi as ca
import numpy as np
from pydantic import Field

from oed.foundation.arrays import Places
from oed.foundation.component import Component
from oed.foundation.errors import Issue
from oed.foundation.quantities import Angle, Length
from oed.foundation.text import count
from oed.kernel.dynamics.expression import Expression
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.system import System
from oed.kernel.measurement.blocks import Block, regression
from oed.kernel.measurement.measurement import Cuts, Measurement
from oed.robots.models.coefficients import coefficient_parameters
from oed.robots.models.model import robot_of

Regressor = Literal["position", "heading", "both"]
NoiseModel = Literal["increments", "absolute"]

WORDS: dict[Regressor, str] = {
    "position": "displacements",
    "heading": "turns",
    "both": "displacements and turns",
}
"""What of the segments is measured, by the regressor."""


class PoseNoise(Component):
    """Standard deviations of a position's and a heading's error [m, rad]."""

    position: Annotated[Length, Field(gt=0)] | None = None
    heading: Annotated[Angle, Field(gt=0)] | None = None


class Displacements(Measurement):
    """Turn and displacement of each of P segments, linear in the coefficients c [Choi, eqs 9-16].

    Of a robot that also moves sideways the position regression has a second set of columns, for the row of
    c that gives the lateral speed.

    Attributes:
        segments: P, or "samples" for one per sample. Segments are as equal as whole samples allow.
        regressor: "position" (c21, c22 from Phi_xy), "heading" (c11, c12 from Phi_theta) or "both".
        noise: standard deviations of one segment's displacement, per coordinate, and turn; with absolute
            noise of one pose's coordinate and heading.
        noise_model: "increments", independent from segment to segment as in the paper; or "absolute":
            the poses between segments are measured, and neighbours share the error of the pose between.
        estimator: of absolute increments, what the information is of: "gls", generalised least squares,
            or "ols", the paper's ordinary ones with their true (sandwich) covariance.
    """

    kind: Literal["displacements"] = "displacements"
    segments: Annotated[int, Field(ge=1)] | Literal["samples"] = 10
    regressor: Regressor = "position"
    noise: PoseNoise = PoseNoise()
    noise_model: NoiseModel = "increments"
    estimator: Literal["gls", "ols"] = "gls"

    def blocks(self, drive: Drive) -> tuple[Block, ...]:
        """One block per regressor: "heading", "position"."""
        builders = {"heading": self._heading_block, "position": self._position_block}
        return tuple(builders[name](drive) for name in self.regressions)

    @property
    def regressions(self) -> tuple[str, ...]:
        """The blocks' names: "heading", "position" or both."""
        return ("heading", "position") if self.regressor == "both" else (self.regressor,)

    def issues(self, system: System, samples: int) -> list[Issue]:
        """Robots without coefficients, more segments than samples, too few to identify two parameters."""
        robot = robot_of(system)
        if not robot.coefficient_names:
            text = f"displacements need a robot whose twist is linear in coefficients; {robot.kind} is not"
            return [Issue(("measurement", "kind"), text)]
        count = self.segment_count(samples)
        if count > samples:
            text = f"expected at most as many segments as there are samples ({samples}), got {count}"
            return [Issue(("measurement", "segments"), text)]
        columns = len(robot.coefficient_names[0])
        if self.regressor != "position" and count < columns:
            text = (
                f"one heading row per segment cannot identify {columns} coefficients: expected at least "
                f"{columns} segments, got {count}"
            )
            return [Issue(("measurement", "segments"), text)]
        return []

    def brief(self, samples: int) -> str:
        """What is measured of how many segments."""
        return f"the {WORDS[self.regressor]} of {count(self.segment_count(samples), 'segment')}"

    def segment_count(self, samples: int) -> int:
        """P for a drive of that many samples."""
        return samples if self.segments == "samples" else self.segments

    def segment_edges(self, samples: int, runs: int = 1) -> Places:
        """Sample indices (P + 1,) at which segments begin and end; those of several runs of that many samples
        follow each other.
        """
        own = np.rint(np.linspace(0, samples, self.segment_count(samples) + 1)).astype(np.int64)
        return np.concatenate([[0], *(run * samples + own[1:] for run in range(runs))])

    def cuts(self, samples: int) -> Cuts | None:
        """Within segments of equal length whose noise is independent."""
        segments = self.segment_count(samples)
        if self.noise_model != "increments" or samples % segments:
            return None
        return Cuts(segment=samples // segments, regression=self.model_copy(update={"segments": 1}))

    @property
    def grid_multiple(self) -> int:
        """P, for segments of equal length."""
        return 1 if self.segments == "samples" else self.segments

    def coarser(self, times: float) -> Displacements:
        """This measurement: segments are parts of the drive, or its samples."""
        return self

    def _heading_block(self, drive: Drive) -> Block:
        rows = drive.period * drive.signals["effective_inputs"]
        matrix = self._segment_sums(drive, every=1, offset=0) @ rows
        return self._block(drive, "heading", matrix, ca.sum1(ca.fabs(rows)))

    def _position_block(self, drive: Drive) -> Block:
        # Rows x, y of each segment alternate, as they are stacked in [Choi, eq. 14].
        effective, gain, direction = (
            drive.signals[name] for name in ("effective_inputs", "gain", "direction")
        )
        columns = effective.shape[1]
        along_x = ca.repmat(gain * ca.cos(direction), 1, columns) * effective
        along_y = ca.repmat(gain * ca.sin(direction), 1, columns) * effective
        if len(robot_of(drive.system).coefficient_names) == 3:
            along_x, along_y = ca.horzcat(along_x, -along_y), ca.horzcat(along_y, along_x)
        matrix = (
            self._segment_sums(drive, every=2, offset=0) @ along_x
            + self._segment_sums(drive, every=2, offset=1) @ along_y
        )
        way = ca.sum1(ca.repmat(ca.fabs(gain), 1, columns) * ca.fabs(effective))
        return self._block(drive, "position", matrix, ca.repmat(way, 1, matrix.shape[1] // columns))

    def _block(self, drive: Drive, name: str, matrix: Expression, summed: Expression) -> Block:
        # The heading row of c turns wheel angles into an angle, the other rows into lengths.
        rows, noise, coordinates = {
            "heading": (slice(0, 1), self.noise.heading, 1),
            "position": (slice(1, None), self.noise.position, 2),
        }[name]
        robot = robot_of(drive.system)
        names = [entry for row in robot.coefficient_names[rows] for entry in row]
        own = [one for one in coefficient_parameters(robot) if one.name in names]
        return regression(
            name,
            matrix,
            names,
            np.array([one.nominal for one in own]),
            units=[one.unit for one in own],
            noise=noise,
            jacobian=self._jacobian(matrix, coordinates, drive.runs),
            summed=summed,
            sizes=np.array([one.scale for one in own]),
            shared=self._shared(matrix.shape[0], coordinates, drive.runs),
        )

    def _jacobian(self, matrix: Expression, coordinates: int, runs: int) -> Expression:
        # W, or rows of which W' (D D')^-1 W is the square, with the first differences D: poses are sums of
        # increments, less their mean. Neighbours share a pose's error within a run only.
        if self.noise_model == "increments" or self.estimator == "ols":
            return matrix
        return ca.vertcat(
            *(
                _centred_sums(run[coordinate::coordinates, :])
                for run in ca.vertsplit(matrix, matrix.shape[0] // runs)
                for coordinate in range(coordinates)
            )
        )

    def _shared(self, rows: int, coordinates: int, runs: int) -> ca.DM | None:
        # D': each pose's error enters the segment before it and, with the other sign, the one after.
        if self.noise_model == "increments" or self.estimator == "gls":
            return None
        count = rows // coordinates // runs
        each = ca.DM.eye(count + 1)[:, 1:] - ca.DM.eye(count + 1)[:, :-1]
        return ca.diagcat(*[ca.kron(each, ca.DM.eye(coordinates))] * runs)

    def _segment_sums(self, drive: Drive, *, every: int, offset: int) -> ca.DM:
        # (every * P, N): row every * i + offset adds up the samples of segment i.
        samples = drive.inputs.shape[0]
        edges = self.segment_edges(drive.samples, drive.runs)
        segment = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
        pattern = ca.Sparsity(
            every * (len(edges) - 1), samples, list(range(samples + 1)), (every * segment + offset).tolist()
        )
        return ca.DM(pattern, 1.0)


def _centred_sums(increments: Expression) -> Expression:
    # G_k - Gbar of the cumulative sums G_0 = 0, ..., G_P of the rows.
    sums = ca.vertcat(0 * increments[0, :], ca.cumsum(increments, 0))
    return sums - ca.repmat(ca.sum1(sums) / sums.shape[0], sums.shape[0], 1)
