"""Cars with inertia, written independently of the package: forces as vectors, integration as in textbooks."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

CAR = {
    "drive_gain": 6.0,
    "viscous_drag": 1.5,
    "stiffness_front": 25.0,
    "stiffness_rear": 28.0,
    "front_axle": 0.16,
    "rear_axle": 0.17,
    "gyration_radius": 0.12,
}
EFFECTS = {
    "drive_gain": 6.0,
    "viscous_drag": 1.5,
    "rolling_resistance": 0.3,
    "air_drag": 0.05,
    **{name: value for name, value in CAR.items() if name not in ("drive_gain", "viscous_drag")},
    "steering_gain": 0.95,
    "steering_offset": 0.02,
}
"""Every effect there is, in the parameters' order."""
LOW_SPEED = 0.3
STAGES = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [2, 0, 0, 0], [2, 0, 1, 0]])
LINEAR = np.array([[0, 0, 0, 0], [4, 0, 0, 0], [1, -1, 0, 0], [1, -1, -8 / 3, 0]])
WEIGHTS = np.array([2, 0, 1, 1])
"""RODAS3 with gamma = 1/2, transformed: arguments of the stages, what is added to them, and the sum."""


def accelerations(speeds: np.ndarray, inputs: np.ndarray, car: dict[str, float]) -> np.ndarray:
    """Of forward speed, lateral speed and yaw rate, by the forces at both axles in the body's frame."""
    ahead, left, yaw_rate = speeds
    angle = car.get("steering_gain", 1.0) * inputs[1] + car.get("steering_offset", 0.0)
    soft = np.sqrt(ahead**2 + LOW_SPEED**2)
    force, moment = np.zeros(2, dtype=speeds.dtype), 0.0
    for name, place, turned in (("front", car["front_axle"], angle), ("rear", -car["rear_axle"], 0.0)):
        across = np.array([-np.sin(turned), np.cos(turned)])
        slip = across @ np.array([ahead, left + place * yaw_rate]) / soft
        pushed = -car[f"stiffness_{name}"] * slip * across
        force, moment = force + pushed, moment + place * pushed[1]
    drag = car["viscous_drag"] * ahead + car.get("air_drag", 0.0) * ahead * soft
    drag = drag + car.get("rolling_resistance", 0.0) * ahead / soft
    driven = car["drive_gain"] * inputs[0] - drag
    return np.array(
        [
            force[0] + driven + yaw_rate * left,
            force[1] - yaw_rate * ahead,
            moment / car["gyration_radius"] ** 2,
        ]
    )


def slopes(state: np.ndarray, inputs: np.ndarray, car: dict[str, float]) -> np.ndarray:
    """Derivatives of (x, y, heading, forward speed, lateral speed, yaw rate)."""
    # No complex numbers for the plane: derivatives are taken along them.
    cosine, sine = np.cos(state[2]), np.sin(state[2])
    turned = np.array([[cosine, -sine], [sine, cosine]]) @ state[3:5]
    return np.array([*turned, state[5], *accelerations(state[3:], inputs, car)])


def rosenbrock(state, inputs, period: float, car: dict[str, float], steps: int) -> np.ndarray:
    """The state after so many steps of RODAS3, its Jacobian by complex steps."""
    length = period / steps
    for _ in range(steps):
        jacobian = np.column_stack(
            [slopes(state + 1e-30j * one, inputs, car).imag / 1e-30 for one in np.eye(6)]
        )
        matrix, stages = 2 * np.eye(6) - length * jacobian, np.zeros((4, 6))
        for stage in range(4):
            slope = slopes(state + STAGES[stage] @ stages, inputs, car)
            stages[stage] = np.linalg.solve(matrix, length * slope + LINEAR[stage] @ stages)
        state = state + WEIGHTS @ stages
    return state


def motion(state, inputs, period: float, values, *, names: list[str], steps: int):
    """The twist on whose arc the pose at the period's end lies, and the speeds there, of a car with these
    values of its parameters.
    """
    car = dict(zip(names, values, strict=True))
    if not period:
        return state[3:], state[3:]
    ended = rosenbrock(np.array([0.0, 0.0, 0.0, *state[3:]]), inputs, period, car, steps)
    # Along an arc the velocity, as a complex number, turns: its integral is (e^(i turn) - 1) / (i turn).
    turn = ended[2]
    velocity = (ended[0] + 1j * ended[1]) / period * (1j * turn / np.expm1(1j * turn) if turn else 1.0)
    return np.array([velocity.real, velocity.imag, turn / period]), ended[3:]


def steady_twist(inputs: np.ndarray, car: dict[str, float]) -> np.ndarray:
    """Where all accelerations are 0: for each forward speed those across and of turning are linear in the
    speeds across and of turning; the forward one is bracketed.
    """

    def cornering(ahead: float) -> np.ndarray:
        base = accelerations(np.array([ahead, 0.0, 0.0]), inputs, car)[1:]
        columns = [accelerations(np.array([ahead, *one]), inputs, car)[1:] - base for one in np.eye(2)]
        return np.array([ahead, *np.linalg.solve(np.column_stack(columns), -base)])

    most = car["drive_gain"] * inputs[0] / car["viscous_drag"]
    if not most:
        return np.zeros(3)
    ends = sorted((0.0, 1.01 * most))
    ahead = brentq(lambda one: accelerations(cornering(one), inputs, car)[0], *ends, xtol=1e-15, rtol=1e-15)
    return cornering(ahead)
