"""A study of 20 lines and logs without poses: from files to a page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sensed import PLACES, gyro, sighted
from simulated import TRUTH, course

import oed
from oed.records.record import load_estimate
from oed.report.estimate import estimate_sections

STUDY = """
format: 1
name: landmarks and a gyro
robot: {kind: differential_drive, wheel_radius: 5 cm, track: 20 cm}
trajectory: {duration: 10 s, samples: 50, spline: {degree: 3, coefficients: 8}}
measurement:
  - kind: landmarks
    landmarks: [[3 m, 2.5 m], [-2.5 m, 2 m], [0.5 m, -3 m], [2.5 m, -2 m]]
    ids: [10, 11, 12, 13]
    noise: {range: 2 cm, bearing: 0.6 deg}
  - {kind: yaw_rate, noise: 0.6 deg/s}
  - {kind: ranges, beacons: [[3 m, 0 m]], noise: 5 cm}
limits: {wheel_speed: 8 rad/s, workspace: {kind: rectangle, x: [-5 m, 5 m], y: [-5 m, 5 m]}}
criterion: {kind: E}
solvers: [{kind: ipopt, starts: 1}]
log:
  poses: none
  sensors:
    landmarks: {id: id, bearing: {column: bearing, unit: deg}, file: "{stem}_landmarks.csv"}
    yaw_rate: {column: gz, unit: deg/s}
"""


def written(folder: Path) -> Path:
    """A log and the landmarks seen beside it."""
    drive = course(seconds=12.0, period=0.1, seed=1)
    rates = np.degrees(gyro(drive, noise=0.01, bias=0.02).values[:, 0])
    wheels = [
        f"{at:.4f},{right:.6f},{left:.6f},{rate:.5f}"
        for at, (right, left), rate in zip(drive.times, drive.inputs, rates, strict=False)
    ]
    log = folder / "log.csv"
    log.write_text("\n".join(["t,wheel_speed_right,wheel_speed_left,gz", *wheels]))
    rows = np.arange(0, len(drive.times), 2)
    seen = sighted(drive, "landmarks", "rb", PLACES, noise=[0.02, 0.01], rows=rows, missing=0.5)
    lines = [
        f"{at:.4f},{place + 10},{values[2 * place]:.5f},{np.degrees(values[2 * place + 1]):.4f}"
        for at, values in zip(seen.times, seen.values, strict=True)
        for place in range(4)
        if np.isfinite(values[2 * place])
    ]
    (folder / "log_landmarks.csv").write_text("\n".join(["t,id,range,bearing", *lines]))
    return log


@pytest.mark.slow
def test_from_files_to_a_page(tmp_path: Path):
    study = oed.parse_study(STUDY)
    oed.estimate(study, written(tmp_path), out=tmp_path / "out")
    found = load_estimate(tmp_path / "out")
    for one in found.parameters:
        assert abs(one.value - TRUTH[one.name]) < 3.5 * one.standard_error
    units = {one.about: one.unit for one in found.noise}
    assert units == {"landmarks.range": "m", "landmarks.bearing": "rad", "yaw_rate": "rad/s"}
    assert {one.quantity for one in found.residuals} == set(units)
    assert [one.name for one in found.nuisances] == ["yaw_rate.bias", "clock_offset"]
    assert any(note.startswith("ranges is not used") for note in found.notes)
    text = " ".join(str(section) for section in estimate_sections(found))
    assert "least squares on all readings together" in text
    assert "Constants of sensors" in text


def test_a_study_names_the_sensors_that_it_measures_with():
    with pytest.raises(oed.StudyError) as caught:
        oed.parse_study(STUDY.replace("    yaw_rate: {column", "    yaw_rates: {column"))
    (issue,) = caught.value.issues
    assert (issue.key, issue.line) == ("log.sensors.yaw_rates", 20)
    assert "did you mean yaw_rate?" in issue.message
