"""Sensors that see hundreds of points: their memory is in proportion to the number of these."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from oed.kernel.measurement.readings import moment_reading
from oed.kernel.measurement.sensor import Sensor
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import Landmarks, Ranges, Tags

ROBOT = DifferentialDrive(wheel_radius=0.05, track=0.2)
MANY = 300
PEAK = """
import sys
import oed

study = oed.load_study(sys.argv[1])
rows = study.problem.any_blocks[0].response.numel()
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(rows, peak.split()[1])
"""
"""A program that prints how many readings a study has, and how much memory [kB] it took to read it."""


def grid(count: int, *more: float) -> tuple[tuple[float, ...], ...]:
    """Places of so many points, each with further coordinates."""
    return tuple((0.1 * (place % 40), 0.1 * (place // 40), *more) for place in range(count))


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensor",
    [
        Ranges(beacons=grid(MANY), noise=0.05),
        Landmarks(landmarks=grid(MANY), noise={"range": 0.05, "bearing": 0.02}),
        Tags(tags=grid(MANY, 0.0), noise={"range": 0.05, "bearing": 0.02, "orientation": 0.02}),
    ],
    ids=lambda sensor: sensor.kind,
)
def test_whitening_of_many_points_has_one_number_for_each_reading(sensor: Sensor):
    """A dense matrix of readings by readings takes gigabytes for thousands of points."""
    function, count = moment_reading(sensor, ROBOT), len(sensor.entries)
    assert [function.size1_out(0), function.nnz_out(2)] == [count, count]
    assert set(sensor.deviations) == set(sensor.deviations[: count // MANY])


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no record of the peak memory")
def test_study_of_a_thousand_beacons_takes_less_than_300_megabytes(tmp_path: Path):
    study = {
        "format": 1,
        "name": "Many beacons",
        "robot": {"kind": "differential_drive", "wheel_radius": 0.05, "track": 0.2},
        "trajectory": {"duration": 8, "samples": 20, "spline": {"degree": 3, "coefficients": 8}},
        "measurement": {"kind": "ranges", "beacons": grid(1000), "noise": 0.05},
        "limits": {"wheel_speed": 8, "wheel_acceleration": 16},
    }
    file = tmp_path / "study.yaml"
    file.write_text(json.dumps(study))
    output = subprocess.run([sys.executable, "-c", PEAK, file], capture_output=True, text=True, check=True)
    rows, peak = map(int, output.stdout.split())
    assert rows == 21 * 1000
    assert peak / 1024 < 300


@pytest.mark.parametrize(
    ("change", "most"), [({}, 5000), ({"map": "unknown"}, 200), ({"map": 0.1}, 200)], ids=str
)
def test_too_many_points_are_refused(change: dict[str, Any], most: int):
    (issue,) = Ranges(beacons=grid(most + 1), noise=0.05, **change).issues(ROBOT, 20)
    assert issue.key == ("measurement", "beacons")
    assert f"at most {most} beacons" in issue.message
    assert Ranges(beacons=grid(most), noise=0.05, **change).issues(ROBOT, 20) == []
