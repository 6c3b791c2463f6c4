"""Study files to be varied in tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from oed.study.study import Study
from oed.workflow.studies import load_study

SMALL = """\
format: 1
name: Small study
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 10 s, samples: 40, spline: {degree: 3, coefficients: 8}}
measurement: {kind: displacements, segments: 4, noise: {position: 1 cm, heading: 1 deg}}
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 20 rad/s^2
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
criterion: {kind: E, scaling: none}
"""
"""A valid study that asks for nothing but its defaults: 10 s, 40 samples, 4 segments."""

IPOPT = "{kind: ipopt, starts: 2, perturbations: 0}"
GENETIC = "{kind: genetic, population: 20, generations: 5}"

INFEASIBLE = """\
format: 1
name: Too fast for its room
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 10 s, samples: 10, spline: {degree: 3, coefficients: 5}, rest_to_rest: false}
measurement: {kind: displacements, segments: 4}
limits:
  wheel_speed: [3 rad/s, 10 rad/s]
  workspace: {kind: rectangle, x: [-10 cm, 10 cm], y: [-10 cm, 10 cm]}
criterion: {kind: E, scaling: none}
solvers: [{kind: ipopt, starts: 1, perturbations: 0}]
"""
"""A study without a solution: never slower than 3 rad/s in a box of 20 cm for 10 s."""


def small(*, solvers: str = IPOPT, **keys: Any) -> str:
    """The small study with these solvers and further top-level keys."""
    lines = [f"solvers: [{solvers}]", *(f"{key}: {value}" for key, value in keys.items())]
    return SMALL + "".join(f"{line}\n" for line in lines)


def write_study(folder: Path, text: str, name: str = "study.yaml") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def without_seconds(data: Any) -> Any:
    """Plain data without what differs from run to run: how long it took, and when it was."""
    if isinstance(data, dict):
        kept = {
            key: value for key, value in data.items() if key not in ("finished", "seconds", "wall_seconds")
        }
        return {key: without_seconds(value) for key, value in kept.items()}
    return [without_seconds(entry) for entry in data] if isinstance(data, list) else data


def saved_study(folder: Path, text: str) -> Study:
    """The study of a file written to `folder`."""
    return load_study(write_study(folder, text))
