"""Records to report on: scored drives with searches' starts written by hand; nothing is solved."""

from __future__ import annotations

from typing import Any

import numpy as np
from recorded import record_from

from oed.kernel.evaluation import evaluate
from oed.kernel.solution import Solution, Status
from oed.records.outcomes import parameter_table, result_of
from oed.records.record import Record
from oed.study.study import Study
from oed.workflow.runner import record as record_of
from oed.workflow.studies import parse_study

TEXT = """\
format: 1
name: Small <robot> | study
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 4 s, samples: 20, spline: {degree: 3, coefficients: 8}, start: {x: 0 m, y: 0 m}}
measurement: {kind: displacements, segments: 4, regressor: REGRESSOR, noise: NOISE}
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 20 rad/s^2
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
criterion: {kind: E, scaling: none}
solvers: [{kind: ipopt, starts: 3, second_stage: logdet}]
"""
SHAPE = np.array([0.0, 0.5, 1.0, 1.0, 1.0, 1.0, 0.5, 0.0])
WAVE = np.array([0.0, 0.6, -0.8, 0.9, -0.7, 0.2, 0.3, 0.0])


SHAPES = {
    "ipopt": (6 * WAVE, 5 * SHAPE),
    "arc": (5 * SHAPE, 3 * SHAPE),
    "straight": (3 * SHAPE, 3 * SHAPE),
    "fast": (30 * SHAPE, 29 * SHAPE),
}
"""Drives by name: winding, an arc, a straight that tells too little, one that breaks limits."""


def solution(study: Study, name: str, right: np.ndarray, left: np.ndarray) -> Solution:
    """A drive that was scored as given."""
    trajectory = study.problem.design.trajectory(np.column_stack([right, left]), [0.0, 0.0, 0.0])
    return Solution(name, "path", trajectory, evaluate(study.problem, trajectory), Status.SCORED)


def drive(study: Study, name: str, right: np.ndarray, left: np.ndarray) -> dict[str, Any]:
    """The same as a record's result."""
    return result_of(solution(study, name, right, left), None).plain()


def scored(regressor: str = "position", noise: str = "{position: 10 cm, heading: 10 deg}") -> dict[str, Any]:
    """A record's data: a winding drive, an arc, a straight (singular) and a fast drive (infeasible)."""
    text = TEXT.replace("REGRESSOR", regressor).replace("NOISE", noise)
    study = parse_study(text)
    return {
        "study": study.echo(),
        "study_text": study.text,
        "parameters": [one.plain() for one in parameter_table(study.problem)],
        "results": [drive(study, name, *pair) for name, pair in SHAPES.items()],
    }


def as_search(entry: dict[str, Any]) -> dict[str, Any]:
    """A result made to look like a search's: three starts, the last without a design, and two stages."""
    best = entry["objective"]
    found = [best, 0.9 * best, None]
    starts = [
        {"objective": value, "status": "converged", "wall_seconds": 0.5, "iterations": 10 * (index + 1)}
        for index, value in enumerate(found)
    ]
    return {
        **entry,
        "kind": "ipopt",
        "status": "converged",
        "message": "Converged.",
        "starts": starts,
        "stages": {"starts": best, "second_stage": 0.999 * best},
        "wall_seconds": 1.5,
    }


SENSORS = """\
format: 1
name: Sensors
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 4 s, samples: 20, spline: {degree: 3, coefficients: 8}}
measurement:
  - kind: poses
    quantities: [x, y]
    every: 5
    noise: {position: 1 cm, position_per_speed: 20 ms}
    initial_pose: {position: 5 cm, heading: 2 deg}
    lever_arm: {x: 6 cm, y: -2 cm, known: false, deviation: 1 cm}
  - kind: ranges
    beacons: [[-1 m, -1 m], [9 m, 1 m]]
    noise: 5 cm
    initial_pose: {position: 5 cm, heading: 2 deg}
  - {kind: yaw_rate, noise: 1 deg/s}
estimate: [wheel_radius_right, wheel_radius_left, track]
prior: {standard_deviations: {wheel_radius_left: 0.2 mm, track: 10 %}}
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 20 rad/s^2
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
criterion: {kind: E}
solvers:
  - {kind: ipopt, starts: 3, second_stage: logdet}
  - {kind: ipopt, name: arc, starts: 3, second_stage: logdet, criterion: {kind: D}}
"""
ABSOLUTE = TEXT.replace("REGRESSOR", "both").replace(
    "noise: NOISE", "noise: {position: 1 cm, heading: 1 deg}, noise_model: absolute"
)


def judged(text: str) -> dict[str, Any]:
    """A record's data as `oed run` would leave it, of the same four drives."""
    study = parse_study(text)
    return record_of(study, [solution(study, name, *pair) for name, pair in SHAPES.items()], 7).data


def as_search_by(entry: dict[str, Any], criterion: str) -> dict[str, Any]:
    """A result made to look like that of a search by another criterion, whose numbers it then has."""
    best = entry["criteria"][criterion]
    found = as_search({**entry, "objective": best})
    for start, lost in zip(found["starts"], (0.0, 0.3, None), strict=True):
        start["objective"] = None if lost is None else best - lost
    history = [
        {"evaluations": 100 * step, "seconds": 0.5 * step, "objective": value}
        for step, value in enumerate((None, best - 0.3, best), 1)
    ]
    stages = {"starts": best - 0.1, "second_stage": best}
    changed = {"criterion": criterion, "history": history, "stages": stages}
    return {**found, **changed, "objective": entry["objective"]}


def simulated(entry: dict[str, Any], parameters: list[dict[str, Any]], estimator: str) -> dict[str, Any]:
    """A validation's entry, with estimates drawn from the promised covariances."""
    sizes = [len(one["parameters"]) for one in entry["covariances"]]
    covariance, first = np.zeros((sum(sizes), sum(sizes))), 0
    for one, size in zip(entry["covariances"], sizes, strict=True):
        covariance[first : first + size, first : first + size] = one["covariance"]
        first += size
    nominal = {one["name"]: one["nominal"] for one in parameters}
    names = [name for one in entry["covariances"] for name in one["parameters"]]
    true = np.array([nominal[name] for name in names])
    estimates = np.random.default_rng(0).multivariate_normal(true, covariance, 50)
    check = {"name": "bias", "question": "is it?", "statistic": 3.0, "expected": [0.0, 2.0], "p_value": 0.01}
    return {
        "name": entry["name"],
        "estimator": estimator,
        "heading": "known",
        "passed": True,
        "verdict": f"{estimator} keeps its promise.",
        "parameters": names,
        "true": true.tolist(),
        "mean": estimates.mean(axis=0).tolist(),
        "promised_covariance": covariance.tolist(),
        "sampled_covariance": np.cov(estimates, rowvar=False).tolist(),
        "paired_variance_ratio": [1.0] * len(names),
        "paired_standard_error": [1e-16] * len(names),
        "checks": [{**check, "passed": True}],
        "estimates": estimates.tolist(),
    }


def validation_of(data: dict[str, Any], estimators: tuple[str, ...], loss: str = "linear") -> dict[str, Any]:
    """A validation of the feasible drives that tell all parameters, by each estimator."""
    told = [
        one for one in data["results"] if one["feasible"] and None not in one["standard_deviations"].values()
    ]
    results = [simulated(one, data["parameters"], estimator) for one in told for estimator in estimators]
    options = {"replicates": 500, "heading": "known", "loss": loss, "alpha": 0.01, "seed": 7}
    return {**options, "estimators": list(estimators), "results": results}


def sensors() -> Record:
    """Three sensors, nuisances and a prior; a search by E, one by D, a singular and an infeasible drive."""
    data = judged(SENSORS)
    first, second, *others = data["results"]
    history = [{"evaluations": 100, "seconds": 0.5, "objective": first["objective"]}]
    data["results"] = [{**as_search(first), "history": history}, as_search_by(second, "D"), *others]
    data["validation"] = validation_of(data, ("nonlinear",), "soft_l1")
    return record_from(data)


def by_criterion(criterion: str) -> Record:
    """The same sensors without a prior, designed for by another criterion of the track alone."""
    kept = [line for line in SENSORS.splitlines() if not line.startswith("prior")]
    text = "\n".join(kept).replace("criterion: {kind: E}", f"criterion: {criterion}")
    return record_from(judged(text))


def absolute() -> Record:
    """Displacements between measured poses, estimated in three ways."""
    data = judged(ABSOLUTE)
    data["validation"] = validation_of(data, ("ols", "sandwich", "gls"))
    return record_from(data)


def full(**options: str) -> Record:
    """Four drives, one of them a search's, and a note."""
    data = scored(**options)
    data["results"][0] = as_search(data["results"][0])
    data["notes"] = ["`bound: true` is read, but <not> computed."]
    return record_from(data)


def single() -> Record:
    data = full().data
    data["results"] = data["results"][:1]
    data["notes"] = []
    return record_from(data)


def many() -> Record:
    """Ten results."""
    data = full().data
    first = data["results"]
    data["results"] = [{**first[index % 4], "name": f"result_{index}"} for index in range(10)]
    return record_from(data)


def without_drive() -> Record:
    """A search that found nothing: null numbers, no drive."""
    data = single().data
    entry = data["results"][0]
    numbers = ("objective", "lambda_min", "lambda_max", "condition_number", "smallest_singular_value")
    entry.update(dict.fromkeys((*numbers, "norm_y", "path_length", "drive", "trajectory")))
    entry.update(feasible=False, margins=[], standard_deviations={}, singular_values=[], stages={})
    entry.update(status="infeasible", message="One limit is in the way: wheel speed (by 2.86 rad/s).")
    for start in entry["starts"]:
        start["objective"] = None
    return record_from(data)


def only_infeasible_drive() -> Record:
    data = full().data
    data["results"] = data["results"][3:]
    return record_from(data)


def unbounded_numbers() -> Record:
    """A singular drive whose infinite numbers JSON holds as null."""
    data = single().data
    entry = data["results"][0]
    entry.update(objective=None, condition_number=None, standard_deviations={"c21": None, "c22": 0.001})
    return record_from(data)


def piecewise_constant() -> Record:
    """A degree-0 drive, no workspace, no limit on the acceleration."""
    data = single().data
    drive = data["results"][0]["drive"]
    drive.update(degree=0, knots=[0.0, 2.0, 4.0], coefficients=[[3.0, 2.0], [-1.0, 4.0]])
    data["study"]["limits"] = {"wheel_speed": {"bounds": [-10.0, 10.0]}}
    return record_from(data)


def empty() -> Record:
    data = single().data
    data["results"] = []
    return record_from(data)


RECORDS = {
    "full": full,
    "many": many,
    "without_drive": without_drive,
    "only_infeasible_drive": only_infeasible_drive,
    "unbounded_numbers": unbounded_numbers,
    "piecewise_constant": piecewise_constant,
    "empty": empty,
    "sensors": sensors,
    "absolute": absolute,
    "by_D": lambda: by_criterion("{kind: D, subset: [track]}"),
    "by_A": lambda: by_criterion("{kind: A}"),
    "by_modified_E": lambda: by_criterion("{kind: modified_E, scaling: none}"),
    "by_G": lambda: by_criterion("{kind: G, test_drive: [{inputs: [5, 5], duration: 2 s}]}"),
    "by_I": lambda: by_criterion(
        "{kind: I, quantity: heading, test_drive: [{inputs: [5, 2], duration: 2 s}]}"
    ),
}


def swept() -> dict[str, Any]:
    """A sweep of two points."""
    points = [
        {
            "values": {"limits.wheel_speed": speed},
            "numbers": {"limits.wheel_speed": float(speed)},
            "label": f"wheel_speed {speed}",
            "folder": f"wheel_speed_{speed}",
            "record": f"wheel_speed_{speed}/record.json",
            "status": "converged",
            "message": "Converged.",
            "seed": 0,
            "design": "ipopt",
            "objective": 3.0,
            "lambda_min": 3.0,
            "standard_deviations": {"track": 0.1},
            "upper_bound": None,
            "gap": None,
            "seconds": 1.0,
        }
        for speed in ("5", "10")
    ]
    key = {"key": "limits.wheel_speed", "name": "wheel_speed", "unit": "rad/s", "values": ["5", "10"]}
    return {
        "format": 1,
        "oed_version": "1",
        "study": "study.yaml",
        "name": "Study",
        "keys": [{**key, "numeric": True}],
        "points": points,
        "best": "wheel_speed_5",
        "comparable": True,
        "kept": 0,
        "interrupted": False,
    }
