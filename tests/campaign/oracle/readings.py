"""What is measured: white Jacobians of sensors by the complex step, and the paper's regressors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from .motion import Motion, chords, drive, lag_shares, rolled
from .robots import Robot, Twist
from .splines import Run

Array = npt.NDArray[Any]

STEP = 1e-30
"""Imaginary step; its square is nothing beside any number here."""
AT_REST = 1e-3
"""Speed [m/s] and yaw rate [rad/s] below which drift rounds their sizes off, as its documentation states."""
NEAREST = 1e-3
"""Distance [m] at which a range is rounded off at its beacon, as its documentation states."""


@dataclass(frozen=True)
class Block:
    """Readings that are estimated together.

    Attributes:
        names: of the parameters.
        nominal: their values, SI, (p,).
        sizes: what relative precisions refer to, (p,).
        rows: white rows of the Jacobian, (M, p + nuisances); of raw blocks in units of the readings.
        noise: what the rows are still to be divided by; None where it is not known.
        known: standard deviations of the nuisances known beforehand, inf for nothing.
        raw: whether `scaling: none` leaves the noise out.
        spread: covariance K of the rows where ordinary least squares ignores it; None otherwise.
    """

    names: tuple[str, ...]
    nominal: Array
    sizes: Array
    rows: Array
    noise: float | None
    known: Array
    raw: bool = False
    spread: Array | None = None


def blocks_of(measurement: Any, robot: Robot, runs: Sequence[Run], rule: str) -> tuple[Block, ...]:
    """What a study's key `measurement` says of a drive."""
    if isinstance(measurement, Mapping) and measurement["kind"] == "displacements":
        return _regressions(measurement, robot, runs, rule)
    sensors = measurement if isinstance(measurement, list) else [measurement]
    return (_joint(sensors, robot, runs, rule),)


# --- sensors ---


def _joint(sensors: Sequence[Mapping[str, Any]], robot: Robot, runs: Sequence[Run], rule: str) -> Block:
    own = [nuisance for sensor in sensors for nuisance in _nuisances(sensor)]
    size, states = len(robot.values), len(robot.states)
    initial = _initial_pose(sensors)
    parts = []
    for number, run in enumerate(runs):
        white = _white_jacobian(sensors, robot, run, rule)
        wide = np.zeros((len(white), size + len(runs) * states + len(own)))
        wide[:, :size] = white[:, :size]
        wide[:, size + number * states : size + (number + 1) * states] = white[:, size : size + states]
        wide[:, size + len(runs) * states :] = white[:, size + states :]
        parts.append(wide)
    rows = np.vstack(parts)
    deviations = np.array([deviation for _, deviation in own])
    if initial == "known":
        rows = np.delete(rows, np.s_[size : size + len(runs) * states], axis=1)
    else:
        deviations = np.concatenate([np.tile(_start_deviations(initial, robot), len(runs)), deviations])
    return Block(robot.names, robot.values, robot.sizes, rows, 1.0, deviations)


def _initial_pose(sensors: Sequence[Mapping[str, Any]]) -> Any:
    # A gyroscope does not care where the robot begins.
    given = [one.get("initial_pose", "unknown") for one in sensors if one["kind"] != "yaw_rate"]
    return given[0] if given else "known"


def _start_deviations(initial: Any, robot: Robot) -> Array:
    if initial == "unknown":
        return np.full(len(robot.states), np.inf)
    by_state = {"x": initial["position"], "y": initial["position"], "yaw_rate": np.inf}
    return np.array([by_state.get(state, initial["heading"]) for state in robot.states])


def _nuisances(sensor: Mapping[str, Any]) -> list[tuple[float, float]]:
    # Nominal value and deviation of each.
    arm = sensor.get("lever_arm", {})
    if sensor["kind"] in ("poses", "ranges") and not arm.get("known", True):
        deviation = arm.get("deviation", np.inf)
        return [(arm.get("x", 0.0), deviation), (arm.get("y", 0.0), deviation)]
    bias = sensor.get("bias", "unknown" if sensor["kind"] == "yaw_rate" else "known")
    if sensor["kind"] in ("yaw_rate", "trailer_angle") and bias != "known":
        return [(0.0, np.inf if bias == "unknown" else float(bias))]
    return []


def displaced(values: Sequence[float], first: int, copies: int) -> list[Array]:
    """Copies (copies, 1) of every value, each displaced in a copy of its own from `first` on."""
    found = []
    for place, value in enumerate(values):
        column = np.full((copies, 1), complex(value))
        column[first + place, 0] += 1j * STEP
        found.append(column)
    return found


def _white_jacobian(sensors: Sequence[Mapping[str, Any]], robot: Robot, run: Run, rule: str) -> Array:
    # By the parameters, the start states and the sensors' nuisances. Drift is not eliminated as the package
    # does, by a filter: all readings are whitened by the covariance that it gives them together.
    own = [_nuisances(sensor) for sensor in sensors]
    size, states, nuisances = len(robot.values), len(robot.states), sum(map(len, own))
    drift = next((one["drift"] for one in sensors if "drift" in one), None)
    shaken = 0 if drift is None else 3 * run.samples
    kept = size + states + nuisances
    copies = 1 + kept + shaken
    p = displaced(robot.values, 1, copies)
    begun = displaced([*run.start, *[0.0] * (states - 3)], 1 + size, copies)
    errors = _shaken(run.samples, 1 + kept, copies) if shaken else None
    motion = drive(robot, run.held, begun, p, run.period, rule, errors)
    found, first = [], 1 + size + states
    for sensor, nuisances in zip(sensors, own, strict=True):
        values = displaced([value for value, _ in nuisances], first, copies)
        first += len(nuisances)
        reading, whitening = _READ[sensor["kind"]](sensor, robot, motion, values, run, p)
        slopes = np.imag(reading[1:]) / STEP
        if callable(whitening):
            found.append(whitening(slopes))
        else:
            found.append(np.einsum("kij,ckj->kic", whitening, slopes).reshape(-1, copies - 1))
    white = np.vstack(found)
    if drift is None:
        return white
    effect = white[:, kept:] * np.sqrt(_drift_variances(drift, motion, run.period))
    return _whitened(np.eye(len(white)) + effect @ effect.T, white[:, :kept])


def _shaken(samples: int, first: int, copies: int) -> Twist:
    # Errors of the motion, each displaced in a copy of its own, period by period.
    errors = np.zeros((copies, samples, 3), dtype=complex)
    for place in range(3 * samples):
        errors[first + place, place // 3, place % 3] = 1j * STEP
    return errors[..., 0], errors[..., 1], errors[..., 2]


def _drift_variances(drift: Mapping[str, float], motion: Motion, period: float) -> Array:
    # Of all errors, period by period: they grow with the way, the turn and the time.
    forward, lateral, yaw = (np.real(one[0]) for one in motion.mean)
    way = period * np.sqrt(forward**2 + lateral**2 + AT_REST**2)
    turn = period * np.sqrt(yaw**2 + AT_REST**2)
    amounts = {"per_metre": way, "per_radian": turn, "per_root_second": np.full(len(way), period)}
    each = [
        sum(drift.get(f"{name}_{cause}", 0.0) ** 2 * amount for cause, amount in amounts.items())
        for name in ("ahead", "sideways", "heading")
    ]
    return np.stack(each, axis=-1).ravel()


def _placed(
    sensor: Mapping[str, Any], motion: Motion, values: list[Array], columns: Array
) -> tuple[Array, Array]:
    # Where the sensor is: its arm turns with the robot.
    x, y, heading = (one[:, columns] for one in motion.states[:3])
    arm = sensor.get("lever_arm", {})
    ahead, left = values or (arm.get("x", 0.0), arm.get("y", 0.0))
    cosine, sine = np.cos(heading), np.sin(heading)
    return x + ahead * cosine - left * sine, y + ahead * sine + left * cosine


def _samples(sensor: Mapping[str, Any], count: int) -> Array:
    return np.arange(0, count, sensor.get("every", 1))


def _read_poses(
    sensor: Mapping[str, Any], robot: Robot, motion: Motion, values: list[Array], run: Run, p: list[Array]
) -> Any:
    columns = _samples(sensor, run.samples + 1)
    x, y = _placed(sensor, motion, values, columns)
    read = {"x": x, "y": y, "heading": motion.states[2][:, columns]}
    quantities = sensor.get("quantities", ["x", "y", "heading"])
    stacked = np.stack([read[name] for name in quantities], axis=-1)
    noise = sensor["noise"]
    if "covariance" in noise:
        matrix = np.array(noise["covariance"], dtype=float)
        if len(matrix) != len(quantities):
            return stacked, lambda slopes: _whitened(matrix, slopes.reshape(len(slopes), -1).T)
        whole = np.linalg.inv(np.linalg.cholesky(matrix))
        return stacked, np.broadcast_to(whole, (len(columns), *whole.shape))
    forward, lateral, yaw = instant(robot, motion, run, p, columns)
    speed, turning = np.real(forward[0] ** 2 + lateral[0] ** 2), np.real(yaw[0] ** 2)
    whitening = np.zeros((len(columns), len(quantities), len(quantities)))
    for place, name in enumerate(quantities):
        sort = "heading" if name == "heading" else "position"
        variance = noise.get(name, noise.get(sort)) ** 2
        for grown in (noise, noise.get("discrepancy", {})):
            variance = variance + grown.get(f"{sort}_per_speed", 0.0) ** 2 * speed
            variance = variance + grown.get(f"{sort}_per_yaw_rate", 0.0) ** 2 * turning
        whitening[:, place, place] = variance**-0.5
    return stacked, whitening


def instant(robot: Robot, motion: Motion, run: Run, p: Sequence[Array], columns: Array) -> Twist:
    """Twists at the samples `columns`, with the inputs held from there on (at the end until there)."""
    held = np.minimum(columns, run.samples - 1)
    asked: Twist = tuple(one[:, held] for one in motion.asked)  # type: ignore[assignment]
    if robot.lag is None:
        return asked
    assert robot.slides is not None
    return robot.slides(rolled(robot, asked, p), motion.states[3][:, columns], p)


def _whitened(covariance: Array, rows: Array) -> Array:
    return np.linalg.solve(np.linalg.cholesky(covariance), rows)


def _read_ranges(
    sensor: Mapping[str, Any], robot: Robot, motion: Motion, values: list[Array], run: Run, p: list[Array]
) -> Any:
    x, y = _placed(sensor, motion, values, _samples(sensor, run.samples + 1))
    distances = [np.sqrt((x - a) ** 2 + (y - b) ** 2 + NEAREST**2) for a, b in sensor["beacons"]]
    stacked = np.stack(distances, axis=-1)
    return stacked, _even(stacked, sensor["noise"])


def _read_yaw_rate(
    sensor: Mapping[str, Any], robot: Robot, motion: Motion, values: list[Array], run: Run, p: list[Array]
) -> Any:
    # The mean of a period.
    bias = values[0] if values else 0.0
    stacked = (motion.mean[2][:, _samples(sensor, run.samples)] + bias)[..., None]
    return stacked, _even(stacked, sensor["noise"])


def _read_trailer(
    sensor: Mapping[str, Any], robot: Robot, motion: Motion, values: list[Array], run: Run, p: list[Array]
) -> Any:
    bias = values[0] if values else 0.0
    stacked = (motion.states[3][:, _samples(sensor, run.samples + 1)] + bias)[..., None]
    return stacked, _even(stacked, sensor["noise"])


def _even(stacked: Array, noise: float) -> Array:
    return np.broadcast_to(np.eye(stacked.shape[2]) / noise, (stacked.shape[1], *[stacked.shape[2]] * 2))


_READ = {
    "poses": _read_poses,
    "ranges": _read_ranges,
    "yaw_rate": _read_yaw_rate,
    "trailer_angle": _read_trailer,
}


# --- the paper's regressions ---


def _regressions(
    measurement: Mapping[str, Any], robot: Robot, runs: Sequence[Run], rule: str
) -> tuple[Block, ...]:
    wanted = measurement.get("regressor", "position")
    both = [_run_regressors(measurement, robot, run, rule) for run in runs]
    rows = robot.coefficient_rows
    assert robot.coefficients is not None
    names = {"heading": rows[0], "position": tuple(name for row in rows[1:] for name in row)}
    nominal = {"heading": robot.coefficients[0], "position": robot.coefficients[1:].ravel()}
    noise = measurement.get("noise", {})
    return tuple(
        _weighted(
            measurement,
            [one[place] for one in both],
            Block(
                names[name],
                nominal[name],
                np.abs(nominal[name]),
                np.zeros(0),
                noise.get(name),
                np.zeros(0),
                True,
            ),
        )
        for place, name in enumerate(("heading", "position"))
        if wanted in (name, "both")
    )


def edges(measurement: Mapping[str, Any], samples: int) -> Array:
    """Samples at which segments begin and end: as equal as whole samples allow."""
    segments = measurement.get("segments", 10)
    count = samples if segments == "samples" else segments
    return np.rint(np.linspace(0, samples, count + 1)).astype(int)


def _run_regressors(measurement: Mapping[str, Any], robot: Robot, run: Run, rule: str) -> tuple[Array, Array]:
    # Phi_theta (1, P, q) and Phi_xy (2, P, q') of one run, coordinate by coordinate [Choi, eqs 10, 14].
    nominal = [np.array([[value]]) for value in robot.values]
    start = [np.array([[value]]) for value in [*run.start, *[0.0] * (len(robot.states) - 3)]]
    motion = drive(robot, run.held, start, nominal, run.period, rule)
    along, across = (one[0] for one in chords(motion.states[2][:, :-1], motion.mean[2], run.period, rule))
    acting = robot.effective(run.held)
    x, y = along[:, None] * acting, across[:, None] * acting
    if len(robot.coefficient_rows) == 3:
        x, y = np.hstack([x, -y]), np.hstack([y, x])
    first = edges(measurement, run.samples)[:-1]
    turns = np.add.reduceat(run.period * acting, first, axis=0)
    return turns[None], np.stack([np.add.reduceat(one, first, axis=0) for one in (x, y)])


def _weighted(measurement: Mapping[str, Any], runs: Sequence[Array], block: Block) -> Block:
    stacked = [coordinate for run in runs for coordinate in run]
    plain = np.vstack(stacked)
    if measurement.get("noise_model", "increments") == "increments":
        return replace(block, rows=plain)
    # Errors of poses, independent: an increment has the error of its end less that of its beginning.
    count = len(stacked[0])
    covariance = 2 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    if measurement.get("estimator", "gls") == "gls":
        return replace(block, rows=np.vstack([_whitened(covariance, one) for one in stacked]))
    return replace(block, rows=plain, spread=np.kron(np.eye(len(stacked)), covariance))


__all__ = ["Block", "blocks_of", "displaced", "edges", "instant", "lag_shares"]
