"""Estimates to report on, written by hand: two logs, one of them oddly named; less than that; hundreds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from oed.records.record import EstimateRecord
from oed.records.stored.parts import plain

Data = dict[str, Any]

ODD = "a|b <i>$x$ `run` *1*"
"""A name that means something else in Markdown, HTML and formulas."""


def read(data: Data) -> EstimateRecord:
    """What a file of such data holds: JSON has no infinite numbers."""
    return EstimateRecord.model_validate(plain(data))


def parameter(name: str, unit: str, nominal: float, value: float, error: float) -> Data:
    return {
        "name": name,
        "unit": unit,
        "nominal": nominal,
        "value": value,
        "standard_error": error,
        "interval": [value - 2 * error, value + 2 * error],
        "standard_errors": {"bootstrap": error, "information": error / 2, "sandwich": 1.1 * error},
    }


def reckoning(position: float) -> Data:
    return {
        "length": 7.0,
        "rmse_position": position,
        "rmse_aligned": position / 2,
        "rmse_heading": position,
        "end_position": 2 * position,
        "end_heading": position,
        "drift_position": position / 4,
        "drift_heading": position / 5,
    }


def part(names: list[str], before: float, after: float) -> Data:
    means = {"before": reckoning(before), "after": reckoning(after)}
    each = {key: [value] * len(names) for key, value in means.items()}
    return {"logs": names, "parameters": [0.0418, 0.2011], **each, "mean": means}


def path(name: str, role: str) -> Data:
    angle = np.linspace(0.0, 5.0, 30)
    circle = {"x": np.cos(angle), "y": np.sin(angle)}
    turned = {
        f"{when}_{axis}": 1.01 * values for when in ("before", "after") for axis, values in circle.items()
    }
    columns = {key: values.tolist() for key, values in {"t": angle, **circle, **turned}.items()}
    columns["x"][10] = columns["y"][10] = None
    headings = {"heading": angle, "before_heading": 1.1 * angle, "after_heading": 1.01 * angle}
    columns |= {key: values.tolist() for key, values in headings.items()}
    return {"log": name, "role": role, **columns, "before": reckoning(0.04), "after": reckoning(0.01)}


def residual(name: str, quantity: str, size: float) -> Data:
    rng = np.random.default_rng(len(name) + len(quantity))
    unit = "rad" if quantity == "heading" else "m"
    values = [*(size * rng.standard_normal(60)).tolist(), 30 * size, None]
    times, speeds = np.linspace(0.0, 9.0, 62).tolist(), np.linspace(0.0, 0.3, 62).tolist()
    rates = {"speed": speeds, "yaw_rate": speeds[::-1]}
    return {"log": name, "quantity": quantity, "unit": unit, "t": times, "value": values, **rates}


def verdict(name: str, about: str, passed: bool, message: str) -> Data:
    return {
        "name": name,
        "about": about,
        "statistic": 2.5,
        "p_value": 1e-20 if not passed else 0.4,
        "passed": passed,
        "message": message,
    }


def score(value: float, difference: float, interval: list[float] | None, equal: bool) -> Data:
    return {"value": value, "difference": difference, "interval": interval, "equal": equal}


def model(name: str, parameters: list[str], scores: Data, reason: str = "", doubt: str = "") -> Data:
    known = bool(scores)
    return {
        "name": name,
        "kind": "skid_steer_slip",
        "own": name == "differential_drive",
        "comparable": not reason,
        "reason": reason,
        "doubt": doubt,
        "parameters": [
            {
                "name": one,
                "unit": "m",
                "value": 0.2 if known else None,
                "standard_error": 0.001 if known else None,
            }
            for one in parameters
        ],
        "unknowns": 9.0 if known else None,
        "starts": 0.0 if known else None,
        "log_likelihood": 432.1 if known else None,
        "scores": scores,
    }


def comparison() -> Data:
    """Three models, of which the wider one is the best, and one that cannot be compared."""
    own = {
        "aicc": score(-840.0, 21.0, [12.0, 30.0], False),
        "bic": score(-820.0, 17.0, [8.0, 26.0], False),
        "held_out": score(0.0311, 0.0101, [0.004, 0.017], False),
    }
    wide = {
        "aicc": score(-861.0, 0.0, None, True),
        "bic": score(-837.0, 0.0, None, True),
        "held_out": score(0.0210, 0.0, None, True),
    }
    odd = {
        "aicc": score(-860.0, 1.0, [-3.0, 5.0], True),
        "bic": score(-830.0, 7.0, [3.0, 11.0], False),
        "held_out": score(0.0212, 0.0002, [-0.0001, 0.0005], True),
    }
    return {
        "models": [
            model("differential_drive", ["wheel_radius", "track"], own),
            model("wide_track", ["wheel_radius", "track", "x_icr"], wide),
            model(ODD, ["track"], odd, doubt="its search did not converge"),
            model("skid_steer", ["slip_outer"], {}, reason="the logs do not tell slip_outer"),
        ],
        "readings": 4000.0,
        "inflation": 4.0,
        "inflation_by": "blocks",
        "best": {"aicc": "wide_track", "bic": "wide_track", "held_out": "wide_track"},
        "agree": True,
        "favourites": ["wide_track"],
    }


def log(name: str, *findings: Data) -> Data:
    return {
        "name": name,
        "file": f"somewhere/{name}.csv",
        "seconds": 70.0,
        "poses": 1400,
        "quantities": ["x", "y", "heading"],
        "clock_offset": 0.03,
        "findings": list(findings),
    }


def finding(name: str, message: str, doubtful: bool = False) -> Data:
    return {"name": name, "message": message, "doubtful": doubtful}


def nuisance(name: str, unit: str, value: float, error: float, file: str | None = None) -> Data:
    return {"name": name, "unit": unit, "value": value, "standard_error": error, "file": file}


def estimate() -> Data:
    """Two logs, one of them oddly named, and one kept apart."""
    gap = finding("gap", "1 gap in the inputs; the longest is 2 s from row 7", doubtful=True)
    names = ("first", ODD)
    return {
        "format": 1,
        "oed_version": "1.2.3",
        "study": {
            "name": "Small <robot>",
            "robot": {"kind": "differential_drive", "track": 0.2},
            "trajectory": {"duration": 60.0},
        },
        "seed": 5,
        "method": "joint",
        "parameters": [
            parameter("wheel_radius", "m", 0.042, 0.0418519676, 1.2884e-05),
            parameter("track", "m", 0.2, 0.20011, 0.00041),
        ],
        "covariance": [[1.66e-10, 0.0], [0.0, 1.7e-7]],
        "correlation": [[1.0, -0.61], [-0.61, 1.0]],
        "covariance_kind": "bootstrap",
        "half_width": 2.0,
        "coefficients": [{"name": "c11", "unit": "", "value": 0.2081, "standard_error": 0.00044}],
        "nuisances": [
            nuisance("sensor_x", "m", 0.0012, 8e-05),
            nuisance("clock_offset", "s", 0.213, 0.009, "somewhere/first.csv"),
            nuisance("clock_offset", "s", -0.031, 0.009, f"somewhere/{ODD}.csv"),
        ],
        "segments": {
            "seconds": 2.0,
            "count": 70,
            "chosen": True,
            "drifts": True,
            "tried": [
                {"seconds": 1.0, "position": 0.0005, "heading": 0.005},
                {"seconds": 2.0, "position": 0.0006, "heading": 0.006},
                {"seconds": None, "position": 0.0009, "heading": 0.009},
            ],
        },
        "noise": [
            {"about": "position", "unit": "m", "at_rest": 0.0006, "per_speed": 0.004, "per_yaw_rate": 0.0},
            {"about": "heading", "unit": "rad", "at_rest": 0.006, "per_speed": 0.0, "per_yaw_rate": 0.01},
        ],
        "converged": True,
        "untold": [],
        "notes": [],
        "diagnostics": [
            verdict(
                "whiteness", "position", False, "position residuals are not white: F^-1 promises too much"
            ),
            verdict("logs_agree", "logs", True, "the logs agree"),
        ],
        "logs": [log("first"), log(ODD, gap)],
        "left_out": [part(["first"], 0.05, 0.03), part([ODD], 0.04, 0.02)],
        "held_out": part(["apart"], 0.0452, 0.021),
        "comparison": comparison(),
        "paths": [path("apart", "held out"), path(ODD, "left out")],
        "residuals": [
            residual(name, quantity, size)
            for name in names
            for quantity, size in (("x", 0.0006), ("y", 0.0006), ("heading", 0.006))
        ],
        "correlations": [
            {"about": "position", "values": [0.4, 0.2, -0.1], "bound": 0.05},
            {"about": "heading", "values": [0.1, 0.0, 0.0], "bound": None},
        ],
    }


def bare() -> Data:
    """One log without positions, and nothing beside it."""
    data = estimate()
    empty = (
        "coefficients",
        "nuisances",
        "noise",
        "diagnostics",
        "left_out",
        "paths",
        "residuals",
        "correlations",
    )
    data.update({key: [] for key in empty})
    data["logs"] = data["logs"][:1]
    data["parameters"] = data["parameters"][:1]
    data["parameters"][0]["standard_errors"] = {"information": 1.3e-05}
    data.update(
        covariance_kind="information",
        held_out=None,
        comparison=None,
        correlation=[[1.0]],
        covariance=[[1e-10]],
    )
    data["segments"] = {"seconds": None, "count": 1, "chosen": False, "drifts": None, "tried": []}
    return data


def without_numbers() -> Data:
    """Numbers that are infinite, or that JSON could not hold."""
    data = estimate()
    first, second = data["parameters"]
    first.update(
        standard_error=None,
        interval=[None, None],
        standard_errors=dict.fromkeys(("information", "bootstrap")),
    )
    second.update(standard_error=math.inf, interval=[-math.inf, math.inf], nominal=0.0)
    data["correlation"] = [[None, None], [None, None]]
    data["half_width"] = None
    for one in (*data["nuisances"], *data["coefficients"]):
        one["standard_error"] = None
    for one in data["diagnostics"]:
        one.update(statistic=None, p_value=None)
    for one in data["left_out"]:
        for when in ("before", "after"):
            one[when] = [{**each, "rmse_heading": None, "drift_heading": None} for each in one[when]]
    data["held_out"]["after"] = [dict.fromkeys(data["held_out"]["after"][0])]
    data["paths"][0]["x"] = [None] * 30
    data["residuals"][0]["value"] = [None] * 62
    data["noise"][0].update(at_rest=None, per_speed=None, per_yaw_rate=None)
    for one in data["comparison"]["models"]:
        one.update(unknowns=None, log_likelihood=None)
        for each in one["scores"].values():
            each.update(value=None, difference=None, interval=[None, None])
    data["oed_version"] = None
    return data


def many() -> Data:
    """Four hundred logs, left out in parts; the third and some later ones are doubtful."""
    data = estimate()
    names = [f"drive_{index:03}" for index in range(400)]
    jump = finding("pose_jump", "the pose jumps once", doubtful=True)
    stands = finding("stationary_end", "the robot stands")
    data["logs"] = [
        log(name, *([jump] if index % 100 == 2 else []), stands) for index, name in enumerate(names)
    ]
    clocks = [
        nuisance("clock_offset", "s", 1e-3 * index, 0.01, f"{name}.csv") for index, name in enumerate(names)
    ]
    data["nuisances"] = [*data["nuisances"][:1], *clocks]
    data["left_out"] = [part(names[first : first + 100], 0.05, 0.02) for first in range(0, 400, 100)]
    data["left_out"][3]["after"][-1] = reckoning(9.5)
    data["residuals"] = [residual(name, "x", 0.001) for name in names]
    return data


KINDS = {"whole": estimate, "bare": bare, "without_numbers": without_numbers, "many": many}
