"""Robots: which twist their inputs ask for, from their geometry, in NumPy and for complex parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, pi, sin
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Twist = tuple[Array, Array, Array]
"""Forward and lateral speed [m/s], yaw rate [rad/s], (copies, N) each."""

SOFT_YAW_RATE, SOFT_DRIFT, SOFT_WHEEL_SPEED = 0.05, 0.01, 0.1
"""Where the slipping robot's magnitudes are rounded, as its documentation states."""
WHEELS = ("wheel_speed_right", "wheel_speed_left")
COLUMNS = {2: ("c11", "c12"), 3: ("c11", "c12", "c13"), 4: ("c11", "c12", "c13", "c14")}


@dataclass(frozen=True)
class Robot:
    """A robot as numbers and functions.

    Attributes:
        inputs: their names.
        names: of the parameters.
        values: nominal, SI, (p,).
        sizes: what relative precisions refer to, (p,), 0 for nothing.
        asked: (inputs (N, inputs), parameters, each (copies, 1)) -> twist.
        slides: (speed, yaw rate, parameters) -> twist of a robot whose yaw rate is a state of its own.
        lag: (parameters) -> tau of that state [s].
        trailer: (parameters) -> hitch offset and trailer length [m].
        effective: inputs as they act on the ground, (N, q), at the nominal parameters.
        coefficients: c of [yaw rate; forward; lateral] = c @ effective inputs, (rows, q); None without.
        sideways: whether any drive has a lateral speed.
        body_radius: [m].
    """

    inputs: tuple[str, ...]
    names: tuple[str, ...]
    values: Array
    sizes: Array
    asked: Callable[[Array, Sequence[Array]], Twist]
    slides: Callable[[Array, Array, Sequence[Array]], Twist] | None = None
    lag: Callable[[Sequence[Array]], Array] | None = None
    trailer: Callable[[Sequence[Array]], tuple[Array, Array]] | None = None
    effective: Callable[[Array], Array] = field(default=lambda inputs: inputs)
    coefficients: Array | None = None
    sideways: bool = False
    body_radius: float = 0.0

    @property
    def states(self) -> tuple[str, ...]:
        """The pose, then a yaw rate that lags or a trailer's angle."""
        more = ("yaw_rate",) if self.lag else ("trailer_angle",) if self.trailer else ()
        return ("x", "y", "heading", *more)

    @property
    def coefficient_rows(self) -> tuple[tuple[str, ...], ...]:
        """Names of c's entries, row by row; () without."""
        if self.coefficients is None:
            return ()
        rows, columns = self.coefficients.shape
        return tuple(tuple(f"c{row + 1}{column + 1}" for column in range(columns)) for row in range(rows))


def robot_of(spec: Mapping[str, Any]) -> Robot:
    """The robot that a study's key `robot` describes, SI."""
    return _KINDS[spec["kind"]](spec)


def through_coefficients(robot: Robot) -> Robot:
    """The same robot with c's entries for parameters [Choi, eq. 5], all else nominal."""
    matrix = robot.coefficients
    assert matrix is not None
    rows, columns = matrix.shape

    def asked(inputs: Array, p: Sequence[Array]) -> Twist:
        acting = robot.effective(inputs).T
        found = [
            sum(p[row * columns + column] * acting[column][None] for column in range(columns))
            for row in range(rows)
        ]
        lateral = found[2] if rows == 3 else 0.0 * found[1]
        return found[1], lateral, found[0]

    nominal = [np.array([[value]]) for value in robot.values]
    trailer = robot.trailer
    return Robot(
        robot.inputs,
        tuple(name for row in robot.coefficient_rows for name in row),
        matrix.ravel(),
        np.abs(matrix).ravel(),
        asked,
        trailer=None if trailer is None else lambda p: trailer(nominal),
        effective=robot.effective,
        coefficients=matrix,
        sideways=rows == 3,
        body_radius=robot.body_radius,
    )


def _made(
    spec: Mapping[str, Any],
    inputs: tuple[str, ...],
    parameters: Sequence[tuple[str, float, float]],
    asked: Callable[[Array, Sequence[Array]], Twist],
    *,
    linear: int | None = None,
    **more: Any,
) -> Robot:
    # `linear`: columns of c, read off the twists of unit inputs.
    names = tuple(name for name, _, _ in parameters)
    values = np.array([value for _, value, _ in parameters])
    sizes = np.array([abs(value) or size for _, value, size in parameters])
    matrix = None
    if linear is not None:
        bare = [0.0 if name.startswith("slip_") else value for name, value, _ in parameters]
        forward, lateral, yaw = asked(np.eye(linear), [np.array([[value]]) for value in bare])
        rows = [yaw[0], forward[0], *([lateral[0]] if more.get("sideways") else [])]
        matrix = np.array([np.broadcast_to(row, (linear,)) for row in rows], dtype=float)
        # What geometry makes 0 is no coefficient of a size of its own.
        matrix[np.abs(matrix) < 1e-12 * np.abs(matrix).max(axis=1, keepdims=True)] = 0.0
    radius = float(spec.get("body_radius", 0.0))
    return Robot(inputs, names, values, sizes, asked, coefficients=matrix, body_radius=radius, **more)


def _geometry(spec: Mapping[str, Any]) -> list[tuple[str, float, float]]:
    both = spec.get("wheel_radius")
    right, left = (both, both) if both else (spec["wheel_radius_right"], spec["wheel_radius_left"])
    return [("wheel_radius_right", right, 0), ("wheel_radius_left", left, 0), ("track", spec["track"], 0)]


def _two_sided(right: Array, left: Array, track: Array) -> Twist:
    # Of the sides' speeds over the ground [Choi, eqs 2, 4].
    forward = (right + left) / 2
    return forward, 0.0 * forward, (right - left) / track


def _differential(spec: Mapping[str, Any]) -> Robot:
    def asked(u: Array, p: Sequence[Array]) -> Twist:
        return _two_sided(p[0] * u[:, 0], p[1] * u[:, 1], p[2])

    return _made(spec, WHEELS, _geometry(spec), asked, linear=2)


def _offset(spec: Mapping[str, Any]) -> Robot:
    def asked(u: Array, p: Sequence[Array]) -> Twist:
        # A point to the left of the axle's middle is slower by the yaw rate times its distance.
        forward, lateral, yaw = _two_sided(p[0] * u[:, 0], p[1] * u[:, 1], p[2])
        return forward - p[3] * yaw, lateral, yaw

    own = [*_geometry(spec), ("sensor_offset", spec.get("sensor_offset", 0.0), spec["track"])]
    return _made(spec, WHEELS, own, asked, linear=2)


def _skid_steer(spec: Mapping[str, Any]) -> Robot:
    width = spec.get("slip_transition", 0.1)

    def outer(u: Array) -> Array:
        # Share of the outer side that the right side has [Choi, eq. 5].
        sizes = np.hypot(u, width)
        return (1 + np.tanh((sizes[:, 0] - sizes[:, 1]) / width)) / 2

    def asked(u: Array, p: Sequence[Array]) -> Twist:
        share = outer(u)
        slip_right = share * p[3] + (1 - share) * p[4]
        slip_left = share * p[4] + (1 - share) * p[3]
        return _two_sided(p[0] * u[:, 0] * (1 - slip_right), p[1] * u[:, 1] * (1 - slip_left), p[2])

    slips = spec.get("slip_outer", 0.0), spec.get("slip_inner", 0.0)

    def effective(u: Array) -> Array:
        share = outer(u)
        right, left = share * slips[0] + (1 - share) * slips[1], share * slips[1] + (1 - share) * slips[0]
        return u * (1 - np.stack([right, left], axis=1))

    own = [*_geometry(spec), ("slip_outer", slips[0], 0), ("slip_inner", slips[1], 0)]
    return _made(spec, WHEELS, own, asked, linear=2, effective=effective)


def _icr(spec: Mapping[str, Any]) -> Robot:
    radius = spec["wheel_radius"]

    def asked(u: Array, p: Sequence[Array]) -> Twist:
        # Each side rolls at its own instantaneous centre [Martinez et al., 2005].
        left, right, ahead, alpha_right, alpha_left = p
        speed_right, speed_left = radius * alpha_right * u[:, 0], radius * alpha_left * u[:, 1]
        yaw = (speed_right - speed_left) / (left - right)
        return speed_left + yaw * left, -ahead * yaw, yaw

    apart = spec["y_icr_left"] - spec["y_icr_right"]
    own = [
        ("y_icr_left", spec["y_icr_left"], 0),
        ("y_icr_right", spec["y_icr_right"], 0),
        ("x_icr", spec.get("x_icr", 0.0), apart),
        ("alpha_right", spec.get("alpha_right", 1.0), 0),
        ("alpha_left", spec.get("alpha_left", 1.0), 0),
    ]
    return _made(spec, WHEELS, own, asked, linear=2, sideways=True)


def _slip(spec: Mapping[str, Any]) -> Robot:
    track = spec["track"]
    optional = (
        ("yaw_lag", 0.0),
        ("track_per_yaw_rate", track),
        ("track_per_curvature", track),
        ("x_icr", track),
        ("y_icr", track),
        ("drift", 1.0),
    )
    own = [*_geometry(spec), *((name, spec[name], size) for name, size in optional if name in spec)]
    places = {name: place for place, (name, _, _) in enumerate(own)}

    def value(name: str, p: Sequence[Array]) -> Any:
        return p[places[name]] if name in places else 0.0

    def slides(speed: Array, yaw: Array, p: Sequence[Array]) -> Twist:
        outwards = value("drift", p) * speed * yaw * np.sqrt(yaw * yaw + SOFT_DRIFT**2)
        return speed + value("y_icr", p) * yaw, -value("x_icr", p) * yaw - outwards, yaw

    def wide(u: Array, p: Sequence[Array]) -> Any:
        # The effective track: wider the faster, or the tighter, the robot is asked to turn.
        plain = (p[0] * u[:, 0] - p[1] * u[:, 1]) / p[2]
        faster = np.sqrt(plain * plain + SOFT_YAW_RATE**2) - SOFT_YAW_RATE
        squares = u[:, 0] ** 2 + u[:, 1] ** 2 + SOFT_WHEEL_SPEED**2
        tighter = (u[:, 0] - u[:, 1]) ** 2 / squares / 2
        return p[2] + value("track_per_yaw_rate", p) * faster + value("track_per_curvature", p) * tighter

    def asked(u: Array, p: Sequence[Array]) -> Twist:
        forward, _, yaw = _two_sided(p[0] * u[:, 0], p[1] * u[:, 1], wide(u, p))
        return slides(forward, yaw, p)

    others = {"yaw_lag", "track_per_yaw_rate", "track_per_curvature", "y_icr", "drift"}
    lag = (lambda p: p[places["yaw_lag"]]) if "yaw_lag" in places else None
    return _made(
        spec,
        WHEELS,
        own,
        asked,
        linear=None if others & set(places) else 2,
        slides=slides,
        lag=lag,
        sideways="x_icr" in places or "drift" in places,
    )


def _tricycle(spec: Mapping[str, Any]) -> Robot:
    def asked(u: Array, p: Sequence[Array]) -> Twist:
        # The steered wheel's velocity along and across the robot, a wheelbase ahead of its origin.
        gain = p[3] if len(p) > 3 else 1.0
        speed, steered = p[0] * u[:, 0], gain * u[:, 1] + p[2]
        return speed * np.cos(steered), 0.0 * speed * steered, speed * np.sin(steered) / p[1]

    own = [
        ("wheel_radius", spec["wheel_radius"], 0),
        ("wheelbase", spec["wheelbase"], 0),
        ("steering_offset", spec.get("steering_offset", 0.0), 1.0),
        *([("steering_gain", spec["steering_gain"], 0)] if "steering_gain" in spec else []),
    ]
    return _made(spec, ("wheel_speed", "steering_angle"), own, asked)


def _ackermann(spec: Mapping[str, Any]) -> Robot:
    def asked(u: Array, p: Sequence[Array]) -> Twist:
        # A bicycle [Rajamani, Vehicle Dynamics and Control, 2.2].
        speed, steered = p[0] * u[:, 0], p[3] * u[:, 1] + p[2]
        return speed + 0.0 * steered, 0.0 * speed * steered, speed * np.tan(steered) / p[1]

    own = [
        ("wheel_radius", spec["wheel_radius"], 0),
        ("wheelbase", spec["wheelbase"], 0),
        ("steering_offset", spec.get("steering_offset", 0.0), 1.0),
        ("steering_gain", spec.get("steering_gain", 1.0), 0),
    ]
    return _made(spec, ("wheel_speed", "steering_angle"), own, asked)


def _rolling(rows: Callable[[Array], Array], p: Sequence[Array], u: Array) -> Twist:
    # Least squares of every wheel's rolling, r w = J (forward, lateral, yaw), by its normal equations: their
    # transpose is not the conjugate one, for parameters are complex. Of one radius for all wheels, or each.
    *radii, arm = p
    radii = radii if len(radii) > 1 else radii * u.shape[1]
    copies = max(np.size(one) for one in p)
    rolled = np.stack(
        [np.broadcast_to(one * u[:, at], (copies, len(u))) for at, one in enumerate(radii)], axis=1
    )
    matrix = np.stack([rows(value) for value in np.broadcast_to(np.ravel(arm), copies)])
    turned = np.swapaxes(matrix, 1, 2)
    twists = np.linalg.solve(turned @ matrix, turned @ rolled)
    forward, lateral, yaw = (twists[:, row] for row in range(3))
    return forward, lateral, yaw


def _radii(spec: Mapping[str, Any], places: Sequence[str]) -> list[tuple[str, float, float]]:
    names = ["wheel_radius", *(f"wheel_radius_{place}" for place in places)]
    return [(name, spec[name], 0) for name in names if name in spec]


def _mecanum(spec: Mapping[str, Any]) -> Robot:
    def rows(arm: Array) -> Array:
        # Front left, front right, rear left, rear right [Muir and Neuman, 1987].
        return np.array([[1, -1, -arm], [1, 1, arm], [1, 1, -arm], [1, -1, arm]])

    places = ("front_left", "front_right", "rear_left", "rear_right")
    names = tuple(f"wheel_speed_{place}" for place in places)
    arm = "half_wheelbase_plus_half_track"
    own = [*_radii(spec, places), (arm, spec[arm], 0)]
    return _made(spec, names, own, lambda u, p: _rolling(rows, p, u), linear=4, sideways=True)


def _omni(spec: Mapping[str, Any]) -> Robot:
    angles = (pi / 3, pi, -pi / 3)

    def rows(distance: Array) -> Array:
        return np.array([[-sin(angle), cos(angle), distance] for angle in angles])

    places = ("front_left", "rear", "front_right")
    names = tuple(f"wheel_speed_{place}" for place in places)
    own = [*_radii(spec, places), ("centre_distance", spec["centre_distance"], 0)]
    return _made(spec, names, own, lambda u, p: _rolling(rows, p, u), linear=3, sideways=True)


def _trailer(spec: Mapping[str, Any]) -> Robot:
    def asked(u: Array, p: Sequence[Array]) -> Twist:
        return _two_sided(p[0] * u[:, 0], p[1] * u[:, 1], p[2])

    length = spec["trailer_length"]
    own = [
        *_geometry(spec),
        ("hitch_offset", spec.get("hitch_offset", 0.0), length),
        ("trailer_length", length, 0),
    ]
    return _made(spec, WHEELS, own, asked, linear=2, trailer=lambda p: (p[3], p[4]))


def _unicycle(spec: Mapping[str, Any]) -> Robot:
    effects = [("omega_per_v", 1.0), ("v_per_omega", 1.0), ("lag_omega", 0.0)]
    given = [(name, spec[name], size) for name, size in effects if name in spec]
    own = [("gain_v", spec["gain_v"], 0), ("gain_omega", spec["gain_omega"], 0), *given]
    places = {name: place for place, (name, _, _) in enumerate(own)}

    def value(name: str, p: Sequence[Array]) -> Array | float:
        return p[places[name]] if name in places else 0.0

    def asked(u: Array, p: Sequence[Array]) -> Twist:
        forward = p[0] * u[:, 0] + value("v_per_omega", p) * u[:, 1]
        return forward, 0.0 * forward, p[1] * u[:, 1] + value("omega_per_v", p) * u[:, 0]

    def slides(speed: Array, yaw: Array, p: Sequence[Array]) -> Twist:
        return speed + 0.0 * yaw, 0.0 * yaw, yaw

    more: dict[str, Any] = {}
    if "lag_omega" in places:
        more = {"slides": slides, "lag": lambda p: p[places["lag_omega"]]}
    return _made(spec, ("v", "omega"), own, asked, **more)


def _loaded(spec: Mapping[str, Any]) -> Robot:
    # The user's own robot of problems/own_robot.py: wheels that shrink with speed.
    def asked(u: Array, p: Sequence[Array]) -> Twist:
        mean = p[0] * (u[:, 0] + u[:, 1]) / 2
        rolling = p[0] - p[2] * np.sqrt(mean * mean + 1e-4)
        return _two_sided(rolling * u[:, 0], rolling * u[:, 1], p[1])

    own = [(name, spec[name], 0) for name in ("wheel_radius", "track", "softness")]
    return _made(spec, WHEELS, own, asked)


_KINDS: dict[str, Callable[[Mapping[str, Any]], Robot]] = {
    "differential_drive": _differential,
    "offset_drive": _offset,
    "skid_steer": _skid_steer,
    "skid_steer_icr": _icr,
    "skid_steer_slip": _slip,
    "tricycle": _tricycle,
    "ackermann": _ackermann,
    "mecanum": _mecanum,
    "omni_three": _omni,
    "tractor_trailer": _trailer,
    "unicycle": _unicycle,
    "python": _loaded,
}
