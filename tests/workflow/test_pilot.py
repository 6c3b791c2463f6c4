"""A skid-steer robot from its first drive to a robust one: simulated physics stays in the room on both."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from places import PROBLEMS

from oed.kernel.dynamics.trajectory import Trajectory
from oed.simulation.physics import FourWheels, Motion, drive
from oed.study.study import Study
from oed.workflow.next_drive import next_drive
from oed.workflow.runner import run
from oed.workflow.studies import parse_study

pytest.importorskip("mujoco")
pytestmark = pytest.mark.slow

PILOT = PROBLEMS / "pilot_skid_steer.yaml"
WHEELS_APART, HALF_SIDE = 0.18, 1.0
RATE = 10.0


def quick_pilot() -> Study:
    text = PILOT.read_text().replace("starts: 6, perturbations: 2", "starts: 1, perturbations: 0")
    text = text.replace("baselines: [circle, figure_eight, random]", "baselines: []")
    # Half as long, with fewer samples and coefficients: found in a sixth of the time.
    text = text.replace("samples: 40", "samples: 8").replace("coefficients: 10", "coefficients: 8")
    text = text.replace("duration: 8 s", "duration: 4 s")
    assert "starts: 1" in text
    assert "samples: 8" in text
    assert "duration: 4 s" in text
    assert "coefficients: 8" in text
    return parse_study(text.replace("kind: scenarios", "kind: scenarios, compare: false, draws: 1000"))


def driven(trajectory: Trajectory) -> Motion:
    return drive(FourWheels(), trajectory.inputs, trajectory.period, rate=RATE)


def write_log(path: Path, motion: Motion, rng: np.random.Generator) -> Path:
    speeds = np.diff(motion.wheel_angles, axis=0) / np.diff(motion.times)[:, None]
    poses = motion.poses + rng.normal(size=motion.poses.shape) * [0.01, 0.01, np.radians(1)]
    rows = ["t,wheel_speed_right,wheel_speed_left,x,y,heading"]
    held = [",".join(map(str, row)) for row in speeds] + [","]
    for time, inputs, pose in zip(motion.times, held, poses, strict=True):
        rows.append(f"{time},{inputs},{','.join(map(str, pose))}")
    path.write_text("\n".join(rows) + "\n")
    return path


def best_drive(record) -> Trajectory:
    trajectory = record.best.drive.trajectory
    assert trajectory is not None
    return trajectory


def farthest(motion: Motion) -> float:
    return float(np.abs(motion.poses[:, :2]).max())


def test_the_pilot_stays_in_the_room_and_the_next_drive_knows_the_track(tmp_path: Path):
    pilot = run(quick_pilot(), workers=1)
    motion = driven(best_drive(pilot))
    assert farthest(motion) < HALF_SIDE
    log = write_log(tmp_path / "pilot.csv", motion, np.random.default_rng(0))
    found = next_drive(pilot, [log], duration=5.0, workers=1)
    track = found.estimate.values["track"]
    # Skidding widens it; in a spin of rigid wheels with dry friction by 1 + (16/18)^2.
    assert 1.4 < track / WHEELS_APART < 2.4
    assert found.study is not None
    assert found.record is not None
    problem = found.study.problem
    assert problem.robust.kind == "chance"
    assert problem.uncertainty is None
    assert problem.design.duration == 5.0
    assert problem.design.period == pytest.approx(0.5)
    second = driven(best_drive(found.record))
    # What slip does beyond the model is not in the reserve: the room is kept to a few centimetres.
    assert farthest(second) < HALF_SIDE + 0.05
    leave = found.record.data["robustness"]["results"][0]
    assert leave["interval"][1] <= 0.01
    json.dumps(found.record.data["robustness"], allow_nan=False)
