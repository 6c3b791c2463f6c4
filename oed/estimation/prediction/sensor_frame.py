"""The robot in its sensor frame: coefficients of the motion of the point where the sensor sits.

A sensor off to the side reads the motion of another robot, whose c21, c22 are shifted along c11, c12: no
motion separates the two. Of a robot that also moves sideways the whole place is hidden like this.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oed.estimation.setup.unknowns import PLACE, Unknowns
from oed.foundation.arrays import Array
from oed.robots.models.model import Model, coefficient_values


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
        hidden = np.where(self._hides, place, 0.0)
        point, turn = 1j * (hidden[0] + 1j * hidden[1]), np.exp(-1j * hidden[2])
        own, slopes = self._coefficients(parameters)
        yaw, speed = own[0], turn * (_speed(own) + point * own[0])
        places = dict(zip(PLACE, (1j * turn * yaw, -turn * yaw, -1j * speed), strict=True))
        by_all = np.zeros((len(yaw), self.unknowns.size), dtype=complex)
        by_all[:, : slopes.shape[-1]] = turn * (_speed(slopes) + point * slopes[0])
        for name in self._taken_in:
            by_all[:, self.unknowns.names.index(name)] = places[name]
        yaw_by_all = np.zeros(by_all.shape)
        yaw_by_all[:, : slopes.shape[-1]] = slopes[0]
        rest = self._rest
        return (
            np.concatenate([*_rows(yaw, speed, len(own)), values[rest]]),
            np.vstack([*_rows(yaw_by_all, by_all, len(own)), np.eye(self.unknowns.size)[rest]]),
        )

    def _coefficients(self, parameters: Array) -> tuple[Array, Array]:
        # The matrix c (rows, inputs), and its derivatives by the parameters that are estimated.
        robot = self.unknowns.robot
        _, values, slopes = coefficient_values(robot, parameters)
        known = [parameter.name for parameter in robot.parameters]
        own = slopes[:, [known.index(name) for name in self.unknowns.parameters]]
        rows = len(robot.coefficient_names)
        return values.reshape(rows, -1), own.reshape(rows, -1, own.shape[-1])

    @property
    def _hides(self) -> list[bool]:
        return [name in hidden_places(self.unknowns.robot) for name in PLACE]

    @property
    def _taken_in(self) -> list[str]:
        return [name for name in self.unknowns.place if name in hidden_places(self.unknowns.robot)]

    @property
    def _rest(self) -> list[int]:
        # Unknowns that are the same in the sensor frame.
        first = len(self.unknowns.parameters)
        names = self.unknowns.names
        return [index for index in range(first, len(names)) if names[index] not in self._taken_in]


def hidden_places(robot: Model) -> tuple[str, ...]:
    """The coordinates of a sensor's place that move the sensor frame as other coefficients would."""
    return PLACE if len(robot.coefficient_names) == 3 else PLACE[1:2]


def _speed(coefficients: Array) -> npt.NDArray[np.complex128]:
    # Rows of forward and, where there is one, lateral speed.
    lateral = coefficients[2] if len(coefficients) == 3 else 0.0
    return np.asarray(coefficients[1] + 1j * lateral)


def _rows(yaw: Array, speed: npt.NDArray[np.complex128], count: int) -> list[Array]:
    return [yaw, speed.real, speed.imag][:count]
