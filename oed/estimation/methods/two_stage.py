"""The paper's two stages: the coefficients of yaw rate from the turns, the others from the displacements.

Both are ordinary least squares on the motions between windows' ends, unweighted [Choi, eqs 10-17]. The error
bars that go with them take rows for independent and the first stage's result for true: a sandwich or a
bootstrap of their scores does not.

The coefficients are those of the robot in its sensor frame, of the motion of the point where the sensor sits.
A sensor off to the side reads the motion of another robot, whose c21, c22 are shifted along c11, c12: no
motion separates the two. Of a robot that also moves sideways the whole place is hidden like this.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from oed.estimation.methods.fit import Fit
from oed.estimation.methods.gauss_newton import LeastSquares, Rows
from oed.estimation.methods.joint import ROUGH
from oed.estimation.methods.motion_noise import motion_likelihood, score_parts
from oed.estimation.methods.windows import TINY, Windows, pose_variances, require_windows
from oed.estimation.setup.unknowns import PLACE, Knowledge, Unknowns, inverse_of_identifiable
from oed.foundation.arrays import Array, Places
from oed.foundation.errors import ProblemError
from oed.robots.models.model import Model
from oed.robots.sensors.logged import Noise


def robot_at_sensor(unknowns: Unknowns) -> Unknowns:
    """The coefficients in the sensor frame, those of its place that they do not hide, and the clocks."""
    robot = unknowns.robot
    names = tuple(name for row in robot.coefficient_names for name in row)
    hidden = hidden_places(robot)
    sits = tuple(0.0 if name in hidden else at for name, at in zip(PLACE, unknowns.sits, strict=True))
    place = tuple(name for name in unknowns.place if name not in hidden)
    return Unknowns(robot.by_coefficients, names, place, unknowns.clocks, (sits[0], sits[1], sits[2]))


@dataclass(frozen=True)
class SensorFrame:
    """The unknowns of `robot_at_sensor` as they follow from those of a robot.

    A point p ahead and to the left, as a complex number, of a robot with yaw rate w moves with v + j w p; a
    sensor turned by a reads that times e^(-j a). The same holds for every column of coefficients.
    """

    unknowns: Unknowns

    def __call__(self, values: Array) -> tuple[Array, Array]:
        """The unknowns in the sensor frame (b,), and its derivatives (b, q), at unknowns (q,)."""
        parameters, place, _ = self.unknowns.parts(values)
        hides, names = hidden_places(self.unknowns.robot), self.unknowns.names
        hidden = np.where([name in hides for name in PLACE], place, 0.0)
        point, turn = 1j * (hidden[0] + 1j * hidden[1]), np.exp(-1j * hidden[2])
        rows, (_, *found) = len(self.unknowns.robot.coefficient_names), self.unknowns.coefficients(parameters)
        own, slopes = (one.reshape(rows, -1, *one.shape[1:]) for one in found)
        yaw, speed = own[0], turn * (_speed(own) + point * own[0])
        places = dict(zip(PLACE, (1j * turn * yaw, -turn * yaw, -1j * speed), strict=True))
        by_all, count = np.zeros((len(yaw), self.unknowns.size), dtype=complex), slopes.shape[-1]
        by_all[:, :count] = turn * (_speed(slopes) + point * slopes[0])
        for name in self.unknowns.place:
            if name in hides:
                by_all[:, names.index(name)] = places[name]
        yaw_by_all = np.zeros(by_all.shape)
        yaw_by_all[:, :count] = slopes[0]
        # Unknowns that are the same in the sensor frame.
        rest = [index for index, name in enumerate(names) if index >= count and name not in hides]
        return (
            np.concatenate([*_rows(yaw, speed, len(own)), values[rest]]),
            np.vstack([*_rows(yaw_by_all, by_all, len(own)), np.eye(self.unknowns.size)[rest]]),
        )


def hidden_places(robot: Model) -> tuple[str, ...]:
    """The coordinates of a sensor's place that move the sensor frame as other coefficients would."""
    return PLACE if len(robot.coefficient_names) == 3 else PLACE[1:2]


def _speed(coefficients: Array) -> npt.NDArray[np.complex128]:
    # Rows of forward and, where there is one, lateral speed.
    lateral = coefficients[2] if len(coefficients) == 3 else 0.0
    return np.asarray(coefficients[1] + 1j * lateral)


def _rows(yaw: Array, speed: npt.NDArray[np.complex128], count: int) -> list[Array]:
    return [yaw, speed.real, speed.imag][:count]


@dataclass(frozen=True)
class _Stage:
    # One ordinary least squares: `rows` of each motion by some columns of the coefficients' unknowns.
    rows: slice
    columns: Places


@dataclass(frozen=True)
class _Solved:
    # Derivatives of a stage's rows (S, rows, k), what is known in units of the noise, and the noise's size.
    slopes: Array
    known: Array
    size: float

    @cached_property
    def inverse(self) -> Array:
        return inverse_of_identifiable(np.einsum("sia,sib->ab", self.slopes, self.slopes) + self.known)


@dataclass(frozen=True)
class TwoStage:
    """The estimator.

    Attributes:
        windows: with what is to be estimated: coefficients, or the parameters they follow from.
        known: of it from before.
        specified: noise of the poses that is not to be estimated.
    """

    windows: Windows
    known: Knowledge
    specified: Mapping[str, Noise] | None = None

    def fit(self) -> Fit:
        """The solution.

        Raises:
            ProblemError: a robot without coefficients, logs without headings or positions, too few windows.
        """
        require_windows(self.windows.layout, self.windows.unknowns, "two_stage")
        if not self.windows.unknowns.robot.coefficient_names:
            text = f"{self.windows.unknowns.robot.kind} has no coefficients; use method: joint or gls"
            raise ProblemError.about(("calibration", "method"), text)
        estimates, stages = self._coefficients()
        values, converged = self._values(estimates, stages)
        return self._fit(values, stages, converged)

    @cached_property
    def _framed(self) -> Windows:
        # The same windows, driven by the robot as the sensor frame moves.
        return replace(self.windows, unknowns=robot_at_sensor(self.windows.unknowns))

    @cached_property
    def _stages(self) -> tuple[_Stage, _Stage]:
        unknowns = self._framed.unknowns
        first = len(unknowns.robot.coefficient_names[0])
        turns = [*range(first), *range(unknowns.size - unknowns.clocks, unknowns.size)]
        moves = [index for index in range(unknowns.size) if index not in turns]
        return _Stage(slice(2, 3), np.array(turns)), _Stage(slice(0, 2), np.array(moves))

    @cached_property
    def _framed_known(self) -> Knowledge:
        # Of clocks and place alone: without it the clocks go astray where turns are steady.
        own, framed = self.windows.unknowns.names, self._framed.unknowns
        information, centre = np.zeros((framed.size,) * 2), np.zeros(framed.size)
        for index in range(len(framed.parameters), framed.size):
            place = own.index(framed.names[index])
            information[index, index] = self.known.information[place, place]
            centre[index] = self.known.centre[place]
        return Knowledge(information, centre)

    def _coefficients(self) -> tuple[Array, list[_Solved]]:
        values, stages = SensorFrame(self.windows.unknowns)(self.windows.unknowns.nominal)[0], []
        for stage in self._stages:
            size = ROUGH
            # How much the knowledge of clocks weighs beside the readings follows from what these leave.
            for _ in range(2):
                values = self._solved(stage, values, size)
                size = self._size(stage, values)
            stages.append(_Solved(*self._rows(stage, values, size), size))
        return values, stages

    def _solved(self, stage: _Stage, values: Array, size: float) -> Array:
        def whole(part: Array) -> Array:
            found = values.copy()
            found[stage.columns] = part
            return found

        def rows(part: Array, _: Array) -> Rows:
            motions = self._framed.motions(whole(part))
            slopes = self._slopes(stage, whole(part))
            return Rows.of(motions.residuals[:, stage.rows] / size, slopes / size)

        known = self._framed_known.on(stage.columns)
        search = LeastSquares(self._framed.unknowns.scale[stage.columns], known)
        return whole(search.solved(rows, values[stage.columns]).values)

    def _slopes(self, stage: _Stage, values: Array) -> Array:
        return self._framed.motions(values).slopes[:, stage.rows][..., stage.columns]

    def _rows(self, stage: _Stage, values: Array, size: float) -> tuple[Array, Array]:
        return self._slopes(stage, values), self._framed_known.on(stage.columns).information * size**2

    def _size(self, stage: _Stage, values: Array) -> float:
        # The standard deviation of a row: of what is left, or as specified for the poses at both ends.
        motions = self._framed.motions(values)
        if self.specified is not None:
            variances = pose_variances(self.specified, self._framed.rates(motions.path)).sum(axis=1)
            return float(np.sqrt(variances[:, stage.rows].mean()))
        residuals = motions.residuals[:, stage.rows]
        degrees = max(residuals.size - len(stage.columns), 1)
        return max(float(np.sqrt((residuals**2).sum() / degrees)), TINY)

    def _values(self, estimates: Array, stages: list[_Solved]) -> tuple[Array, bool]:
        # The unknowns whose coefficients fit best, weighted by how sure the stages are of each.
        framed = SensorFrame(self.windows.unknowns)
        # What was known of place and clocks is in the stages' estimates already.
        information = self._information(stages).sum(axis=0) + self._framed_known.information
        size = np.sqrt(np.where(np.diag(information) > 0, np.diag(information), 1.0))
        eigenvalues, vectors = np.linalg.eigh(information / np.outer(size, size))
        root = np.sqrt(np.clip(eigenvalues, 0.0, None))[:, None] * vectors.T * size

        def rows(values: Array, _: Array) -> Rows:
            found, slopes = framed(values)
            return Rows.of(root @ (estimates - found), root @ slopes)

        unknowns = self.windows.unknowns
        found = LeastSquares(unknowns.scale, self._known_of_parameters).solved(rows, unknowns.nominal)
        return found.values, found.arrived

    @property
    def _known_of_parameters(self) -> Knowledge:
        # Of parameters, and of places that the coefficients absorb: only the last fit shows these.
        own, framed, known = self.windows.unknowns, self._framed.unknowns.names, self.known
        absorbed = [own.names.index(name) for name in own.place if name not in framed]
        kept = [*range(len(own.parameters)), *absorbed]
        information = np.zeros_like(known.information)
        information[np.ix_(kept, kept)] = known.information[np.ix_(kept, kept)]
        return Knowledge(information, known.centre)

    def _information(self, stages: list[_Solved]) -> Array:
        # Of every window, (S, b, b), on the coefficients' unknowns.
        found = np.zeros((self.windows.layout.count, *(self._framed.unknowns.size,) * 2))
        for stage, one in zip(self._stages, stages, strict=True):
            own = np.einsum("sia,sib->sab", one.slopes, one.slopes) / one.size**2
            found[:, stage.columns[:, None], stage.columns] = own
        return found

    def _fit(self, values: Array, stages: list[_Solved], converged: bool) -> Fit:
        windows, motions = self.windows, self.windows.motions(values)
        framed, slopes = SensorFrame(windows.unknowns)(values)
        pulls = self._pulls(framed, stages) @ slopes
        noise = motion_likelihood(windows, self.known, values, self.specified)
        turns, moves = (one.size for one in stages)
        white = motions.residuals / np.array([moves, moves, turns])
        leverage = [
            np.einsum("sia,ab,sib->si", one.slopes, one.inverse, one.slopes) for one in reversed(stages)
        ]
        return windows.fit(
            values,
            white=white,
            leverage=np.concatenate(leverage, axis=1),
            noises=self._noises(turns, moves),
            information=slopes.T @ self._information(stages) @ slopes,
            scores=np.einsum("sia,si->sa", pulls, motions.residuals),
            knowledge=self.known.information,
            converged=converged,
            parts=score_parts(noise, pulls.reshape(-1, pulls.shape[-1])),
        )

    def _pulls(self, framed: Array, stages: list[_Solved]) -> Array:
        # Derivatives of the scores by every window's motion, (S, 3, b). The second stage's carry the first
        # one's errors along, which the information knows nothing of.
        pulls = np.zeros((self.windows.layout.count, 3, len(framed)))
        for stage, one in zip(self._stages, stages, strict=True):
            pulls[:, stage.rows, stage.columns] = one.slopes / one.size**2
        (turns, moves), (first, second) = self._stages, stages
        carried = self._framed.motions(framed).slopes[:, moves.rows][..., turns.columns]
        cross = np.einsum("sia,sib->ab", second.slopes, carried) / second.size**2
        pulls[:, turns.rows, moves.columns] = -first.slopes @ first.inverse @ cross.T
        return pulls

    def _noises(self, turns: float, moves: float) -> Mapping[str, Noise]:
        # As if all that is left were noise of the poses at both ends.
        if self.specified is not None:
            return self.specified
        return {"position": Noise(moves / math.sqrt(2)), "heading": Noise(turns / math.sqrt(2))}
