"""Random robots of every kind, from a millimetre to some ten metres."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from .quantities import UNITS, Quantity, log_uniform, one_of

OWN_ROBOT = Path(__file__).parents[3] / "problems"
"""Where the user's own robot stands that the campaign drives as well."""
PRESET_SHARE = 0.08
Rng = np.random.Generator


def draw_robot(rng: Rng) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """A robot: its keys, the same as a study may write them, and limits that come with a preset."""
    if rng.random() < PRESET_SHARE:
        return _preset(rng)
    size = log_uniform(rng, 1e-3, 20.0)
    kind = one_of(rng, _KINDS)
    robot = {"kind": kind, **_KINDS[kind](rng, size)}
    return robot, robot, {}


def scale_of(robot: dict[str, Any]) -> float:
    """A robot's size [m]: the longest of its lengths."""
    if robot["kind"] == "python":
        return float(robot["track"])
    lengths = [value for value in robot.values() if isinstance(value, Quantity) and value.unit == "m"]
    return max(abs(float(value)) for value in lengths)


def wheel_radius(robot: dict[str, Any]) -> float:
    """Of its largest wheel [m]; of a robot on commands half its size."""
    if robot["kind"] == "unicycle":
        return scale_of(robot) / 2
    return max(float(value) for key, value in robot.items() if key.startswith("wheel_radius"))


def _preset(rng: Rng) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    name = one_of(rng, _preset_names())
    found = _read_preset(name)
    written = {"preset": name}
    robot = dict(found["robot"])
    if "body_radius" in robot and rng.random() < 0.3:
        # null leaves one out.
        robot.pop("body_radius")
        written["body_radius"] = None
    return robot, written, found["limits"]


@cache
def _preset_names() -> tuple[str, ...]:
    files = resources.files("oed.robots.presets").iterdir()
    return tuple(sorted(file.name[:-5] for file in files if file.name.endswith(".yaml")))


def _read_preset(name: str) -> dict[str, dict[str, Any]]:
    text = resources.files("oed.robots.presets").joinpath(f"{name}.yaml").read_text(encoding="utf-8")
    data = yaml.safe_load(text)
    return {
        part: {key: _quantity(value) for key, value in data[part].items()} for part in ("robot", "limits")
    }


def _quantity(value: Any) -> Any:
    if not isinstance(value, str) or not value[0].isdigit():
        return value
    number, unit = value.split(" ", 1)
    for si, names in UNITS.items():
        if unit in names:
            return Quantity(float(number) * names[unit], si)
    raise ValueError(f"an unknown unit in a preset: {value}")


def _length(value: float) -> Quantity:
    return Quantity(value, "m")


def _geometry(rng: Rng, size: float) -> dict[str, Any]:
    radius = size * rng.uniform(0.1, 0.5)
    if rng.random() < 0.5:
        radii = {"wheel_radius": _length(radius)}
    else:
        other = radius * rng.uniform(0.8, 1.2)
        radii = {"wheel_radius_right": _length(radius), "wheel_radius_left": _length(other)}
    body = {"body_radius": _length(size * rng.uniform(0.3, 0.8))} if rng.random() < 0.3 else {}
    return {**radii, "track": _length(size), **body}


def _differential(rng: Rng, size: float) -> dict[str, Any]:
    return _geometry(rng, size)


def _offset(rng: Rng, size: float) -> dict[str, Any]:
    # Above a wheel, too, where a coefficient is 0 but for rounding.
    offset = one_of(rng, (0.0, rng.uniform(-1, 1) * size, size / 2))
    return {**_geometry(rng, size), "sensor_offset": _length(offset)}


def _skid_steer(rng: Rng, size: float) -> dict[str, Any]:
    slips = {"slip_outer": float(rng.uniform(0.01, 0.4)), "slip_inner": -float(rng.uniform(0.01, 0.3))}
    return {
        **_geometry(rng, size),
        **slips,
        "slip_transition": Quantity(log_uniform(rng, 0.05, 1.0), "rad/s"),
    }


def _icr(rng: Rng, size: float) -> dict[str, Any]:
    return {
        "wheel_radius": _length(size * rng.uniform(0.1, 0.5)),
        "y_icr_left": _length(size * rng.uniform(0.4, 1.5)),
        "y_icr_right": _length(-size * rng.uniform(0.4, 1.5)),
        "x_icr": _length(one_of(rng, (0.0, size * rng.uniform(-0.5, 0.5)))),
        "alpha_right": float(rng.uniform(0.7, 1.1)),
        "alpha_left": float(rng.uniform(0.7, 1.1)),
    }


def _slip(rng: Rng, size: float) -> dict[str, Any]:
    effects = {
        "yaw_lag": Quantity(log_uniform(rng, 0.02, 2.0), "s"),
        "track_per_yaw_rate": float(size * rng.uniform(0.0, 0.3)),
        "track_per_curvature": _length(size * rng.uniform(0.0, 0.8)),
        "x_icr": _length(size * rng.uniform(-0.3, 0.3)),
        "y_icr": _length(size * rng.uniform(-0.2, 0.2)),
        "drift": float(rng.uniform(0.0, 0.05)),
    }
    taken = {name: value for name, value in effects.items() if rng.random() < 0.35}
    return {**_geometry(rng, size), **taken}


def _tricycle(rng: Rng, size: float) -> dict[str, Any]:
    gain = {"steering_gain": float(rng.uniform(0.8, 1.2))} if rng.random() < 0.5 else {}
    return {**_steered(rng, size), **gain}


def _steered(rng: Rng, size: float) -> dict[str, Any]:
    offset = Quantity(one_of(rng, (0.0, rng.uniform(-0.1, 0.1))), "rad")
    return {
        "wheel_radius": _length(size * rng.uniform(0.1, 0.4)),
        "wheelbase": _length(size),
        "steering_offset": offset,
    }


def _ackermann(rng: Rng, size: float) -> dict[str, Any]:
    return {**_steered(rng, size), "steering_gain": float(rng.uniform(0.8, 1.2))}


def _mecanum(rng: Rng, size: float) -> dict[str, Any]:
    places = ("front_left", "front_right", "rear_left", "rear_right")
    return {**_rollers(rng, size, places), "half_wheelbase_plus_half_track": _length(size)}


def _omni(rng: Rng, size: float) -> dict[str, Any]:
    places = ("front_left", "rear", "front_right")
    return {**_rollers(rng, size, places), "centre_distance": _length(size)}


def _rollers(rng: Rng, size: float, places: tuple[str, ...]) -> dict[str, Any]:
    radius = size * rng.uniform(0.1, 0.5)
    if rng.random() < 0.7:
        return {"wheel_radius": _length(radius)}
    return {f"wheel_radius_{place}": _length(radius * rng.uniform(0.9, 1.1)) for place in places}


def _trailer(rng: Rng, size: float) -> dict[str, Any]:
    return {
        **_geometry(rng, size),
        "hitch_offset": _length(one_of(rng, (0.0, size * rng.uniform(-0.3, 0.5)))),
        "trailer_length": _length(size * rng.uniform(0.5, 2.5)),
    }


def _unicycle(rng: Rng, size: float) -> dict[str, Any]:
    effects = {
        "omega_per_v": float(rng.uniform(-0.1, 0.1) / size),
        "v_per_omega": float(rng.uniform(-0.1, 0.1) * size),
        "lag_omega": Quantity(log_uniform(rng, 0.02, 2.0), "s"),
    }
    taken = {name: value for name, value in effects.items() if rng.random() < 0.4}
    gains = {name: float(rng.uniform(0.7, 1.2)) for name in ("gain_v", "gain_omega")}
    return {**gains, **taken, "body_radius": _length(size)}


def _own(rng: Rng, size: float) -> dict[str, Any]:
    radius = size * rng.uniform(0.1, 0.5)
    return {
        "object": "own_robot:LoadedDrive",
        "folder": str(OWN_ROBOT),
        "wheel_radius": float(radius),
        "track": float(size),
        "softness": float(radius * rng.uniform(0.001, 0.02)),
    }


_KINDS: dict[str, Callable[[Rng, float], dict[str, Any]]] = {
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
    "python": _own,
}
