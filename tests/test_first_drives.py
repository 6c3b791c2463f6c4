"""Independent simulation of uncalibrated robots on first drives, on drives with a closed form."""

from __future__ import annotations

import json
from pathlib import Path

import cars
import numpy as np
import pytest

from benchmarks.first_drives import car_slopes, main, outside


def written_run(folder: Path, half_width: float, way: float = 1.4) -> Path:
    """A run's folder: a robot drives straight on for `way` metres in a workspace that ends at 1.5 m."""
    radius, samples = 0.05, 10
    speeds = np.full(samples + 1, way / radius)
    rows = np.column_stack([np.linspace(0, 1, samples + 1), speeds, speeds, np.zeros((samples + 1, 3))])
    header = "t,wheel_speed_right,wheel_speed_left,x,y,heading"
    np.savetxt(folder / "ipopt.csv", rows, delimiter=",", header=header, comments="")
    robot = {"kind": "differential_drive", "wheel_radius": radius, "track": 0.3, "body_radius": 0.0}
    ends = {"low": radius * (1 - half_width), "high": radius * (1 + half_width)}
    names = ("wheel_radius_right", "wheel_radius_left")
    record = {
        "best": "ipopt",
        "inputs": [{"name": "wheel_speed_right"}, {"name": "wheel_speed_left"}],
        "robustness": {"uncertain": [{"name": name, **ends} for name in names]},
        "study": {
            "robot": robot,
            "trajectory": {"duration": 1.0},
            "limits": {"workspace": {"kind": "rectangle", "x": [-1.5, 1.5], "y": [-1.5, 1.5]}},
        },
    }
    (folder / "record.json").write_text(json.dumps(record))
    return folder


def test_robots_within_the_workspace_are_counted_as_inside(tmp_path: Path):
    result = outside(written_run(tmp_path, half_width=0.02))
    assert result.count == 0
    assert result.upper == pytest.approx(1 - 0.025 ** (1 / 2000), rel=1e-9)
    assert main([str(tmp_path)]) == 0


def test_robots_that_leave_the_workspace_are_counted(tmp_path: Path):
    # One arc each: how far ahead its chord reaches, for the same draws.
    result = outside(written_run(tmp_path, half_width=0.2), seed=3)
    right, left = 1.4 * np.random.default_rng(3).uniform(0.8, 1.2, (2000, 2)).T
    turn = (right - left) / 0.3
    ahead = (right + left) / 2 * np.sin(turn) / turn
    assert result.count == (ahead > 1.5 * (1 + 1e-3)).sum() > 100
    assert main([str(tmp_path)]) == 1


def test_slopes_of_cars_are_those_of_forces_as_vectors():
    state, inputs = np.array([0.3, -0.2, 0.7, 1.1, -0.2, 0.9]), np.array([0.4, 0.25])
    car = {name: np.array([value]) for name, value in cars.CAR.items()}
    np.testing.assert_allclose(
        car_slopes(state[:, None], inputs, car)[:, 0], cars.slopes(state, inputs, cars.CAR), rtol=1e-12
    )
