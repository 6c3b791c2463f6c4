"""Random measurements: the paper's displacements, and sensors alone or together."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..oracle.robots import Robot
from .quantities import Quantity, log_uniform, one_of, plain

Rng = np.random.Generator


def draw_measurement(rng: Rng, robot: Robot, samples: int, reach: float) -> Any:
    """What is measured of a robot's drives that reach so far [m]."""
    columns = len(robot.coefficient_rows[0]) if robot.coefficient_rows else 0
    if columns and rng.random() < 0.4:
        return _displacements(rng, columns, samples, reach)
    count = one_of(rng, (1, 1, 1, 2, 3))
    # Bare numbers: sensors must agree on them to the last digit, in whatever unit.
    initial = plain(_initial_pose(rng, reach))
    kinds = ["poses", "poses", "ranges", "yaw_rate", *(["trailer_angle"] if robot.trailer else [])]
    sensors = [_SENSORS[one_of(rng, kinds)](rng, samples, reach, initial) for _ in range(count)]
    if (placed := _may_drift(sensors)) and rng.random() < 0.3:
        # One robot drifts, whichever of its sensors says so.
        one_of(rng, placed)["drift"] = _drift(rng, reach)
    return sensors[0] if count == 1 and rng.random() < 0.7 else sensors


def _displacements(rng: Rng, columns: int, samples: int, reach: float) -> dict[str, Any]:
    regressor = one_of(rng, ("position", "position", "heading", "both"))
    least = 1 if regressor == "position" else columns
    if samples < least:
        regressor, least = "position", 1
    segments: Any = int(rng.integers(least, samples + 1))
    if rng.random() < 0.25:
        segments = "samples"
    noise = {
        "position": Quantity(reach * log_uniform(rng, 1e-4, 1e-1), "m"),
        "heading": Quantity(log_uniform(rng, 1e-3, 0.2), "rad"),
    }
    model = one_of(rng, ("increments", "increments", "absolute"))
    estimator = {"estimator": one_of(rng, ("gls", "ols"))} if model == "absolute" else {}
    return {
        "kind": "displacements",
        "segments": segments,
        "regressor": regressor,
        "noise": noise,
        "noise_model": model,
        **estimator,
    }


def _may_drift(sensors: list[dict[str, Any]]) -> list[dict[str, Any]]:
    # Those whose readings can tell, unless one covariance says of all readings how they err together.
    poses = [one for one in sensors if one["kind"] == "poses" and "covariance" in one["noise"]]
    if any(len(one["noise"]["covariance"]) > len(one["quantities"]) for one in poses):
        return []
    return [one for one in sensors if one["kind"] in ("poses", "ranges")]


def _drift(rng: Rng, reach: float) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, unit, size in (
        ("ahead", "m", 0.1 * reach),
        ("sideways", "m", 0.1 * reach),
        ("heading", "rad", 1.0),
    ):
        for cause in ("metre", "radian", "root_second"):
            if rng.random() < 0.4:
                found[f"{name}_per_{cause}"] = Quantity(size * log_uniform(rng, 1e-4, 1e-1), unit)
    return found or {"heading_per_metre": Quantity(0.01, "rad")}


def _initial_pose(rng: Rng, reach: float) -> Any:
    prior = {
        "position": Quantity(reach * log_uniform(rng, 1e-3, 0.1), "m"),
        "heading": Quantity(log_uniform(rng, 0.01, 0.5), "rad"),
    }
    return one_of(rng, ("unknown", "known", prior))


def _placed(rng: Rng, reach: float, initial: Any) -> dict[str, Any]:
    found: dict[str, Any] = {"initial_pose": initial}
    if rng.random() < 0.4:
        arm: dict[str, Any] = {axis: Quantity(0.1 * reach * rng.uniform(-1, 1), "m") for axis in ("x", "y")}
        if rng.random() < 0.5:
            arm["known"] = False
            if rng.random() < 0.5:
                arm["deviation"] = Quantity(0.02 * reach, "m")
        found["lever_arm"] = arm
    return found


def _poses(rng: Rng, samples: int, reach: float, initial: Any) -> dict[str, Any]:
    every = int(one_of(rng, (1, 1, 1, 2, 3, 5)))
    quantities = one_of(rng, (["x", "y", "heading"], ["x", "y"], ["heading", "x"], ["y"], ["heading"]))
    read = {"kind": "poses", "every": every, "quantities": quantities, **_placed(rng, reach, initial)}
    return {**read, "noise": _pose_noise(rng, quantities, samples // every + 1, reach)}


def _pose_noise(rng: Rng, quantities: list[str], readings: int, reach: float) -> dict[str, Any]:
    position, heading = reach * log_uniform(rng, 1e-5, 1e-2), log_uniform(rng, 1e-4, 0.1)
    sort = rng.random()
    if sort < 0.2:
        count = len(quantities) * (readings if sort < 0.05 and readings < 15 else 1)
        deviations = np.array(
            [heading if name == "heading" else position for name in quantities] * (count // len(quantities))
        )
        return {"covariance": _covariance(rng, deviations)}
    noise: dict[str, Any] = {"position": Quantity(position, "m"), "heading": Quantity(heading, "rad")}
    if sort < 0.4:
        noise["x"] = Quantity(position * rng.uniform(0.5, 2), "m")
    if sort > 0.7:
        noise["position_per_speed"] = Quantity(log_uniform(rng, 1e-4, 1e-2), "s")
        noise["heading_per_yaw_rate"] = Quantity(log_uniform(rng, 1e-4, 1e-2), "s")
    if rng.random() < 0.25:
        noise["discrepancy"] = {
            "position_per_speed": Quantity(log_uniform(rng, 1e-4, 1e-1), "s"),
            "heading_per_speed": log_uniform(rng, 1e-4, 1e-1),
            "position_per_yaw_rate": log_uniform(rng, 1e-5, 1e-2),
            "heading_per_yaw_rate": Quantity(log_uniform(rng, 1e-4, 1e-1), "s"),
        }
    return noise


def _covariance(rng: Rng, deviations: np.ndarray[Any, Any]) -> list[list[float]]:
    mixed = (
        np.eye(len(deviations))
        + 0.3 * rng.standard_normal((len(deviations), len(deviations))) / len(deviations) ** 0.5
    )
    matrix = mixed @ mixed.T * np.outer(deviations, deviations)
    return ((matrix + matrix.T) / 2).tolist()


def _ranges(rng: Rng, samples: int, reach: float, initial: Any) -> dict[str, Any]:
    count = int(rng.integers(1, 5))
    beacons = [[Quantity(reach * value, "m") for value in rng.uniform(-3, 3, 2)] for _ in range(count)]
    every = int(one_of(rng, (1, 1, 2)))
    noise = Quantity(reach * log_uniform(rng, 1e-4, 1e-2), "m")
    return {
        "kind": "ranges",
        "beacons": beacons,
        "noise": noise,
        "every": every,
        **_placed(rng, reach, initial),
    }


def _yaw_rate(rng: Rng, samples: int, reach: float, initial: Any) -> dict[str, Any]:
    bias = one_of(rng, ("unknown", "known", Quantity(0.05, "rad/s")))
    return {"kind": "yaw_rate", "noise": Quantity(log_uniform(rng, 1e-3, 0.1), "rad/s"), "bias": bias}


def _trailer_angle(rng: Rng, samples: int, reach: float, initial: Any) -> dict[str, Any]:
    bias = one_of(rng, ("unknown", "known", Quantity(0.02, "rad")))
    noise = Quantity(log_uniform(rng, 1e-3, 0.1), "rad")
    return {"kind": "trailer_angle", "noise": noise, "bias": bias, "initial_pose": initial}


_SENSORS = {"poses": _poses, "ranges": _ranges, "yaw_rate": _yaw_rate, "trailer_angle": _trailer_angle}
