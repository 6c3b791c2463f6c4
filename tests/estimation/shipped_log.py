"""The log that is shipped with problems/room_robot.yaml, simulated without the package's own integration.

Run as a script it writes the file anew.
"""

from __future__ import annotations

import numpy as np
from places import PROBLEMS

from oed.robots.baselines import baselines
from oed.workflow.studies import load_study

STUDY = PROBLEMS / "room_robot.yaml"
FILE = PROBLEMS / "logs" / "room_robot.csv"

TRUTH = {"wheel_radius_right": 0.03255, "wheel_radius_left": 0.0332, "track": 0.1632}
SITS = (0.04, -0.01, np.deg2rad(2.0))
"""Where the tracker's target sits: ahead, to the left [m], turned [rad]."""
BEHIND = 0.12
"""What the encoders' clock shows when the tracker's shows 0 [s]."""
NOISE = (0.002, np.deg2rad(0.3))
FINE, STEP = 1e-3, 50
"""Step of the simulation [s], and how many of them lie between two readings."""
TICKS, WRAP, FIRST = 4096 / (2 * np.pi), 65536, (65000, 120)


def text() -> str:
    """The file's content."""
    study = load_study(STUDY)
    # The figure eight that is best where nothing drifts: the simulated robot does not.
    (drive,) = baselines(study.problem.steady, "figure_eight")
    speeds = np.repeat(drive.trajectory.inputs, round(drive.trajectory.period / FINE), axis=0)
    # Standing before and after, so that both clocks see the whole drive.
    still = np.zeros((1000, 2))
    speeds = np.vstack([still, speeds, still])
    times = FINE * np.arange(len(speeds) + 1)
    turned = np.vstack([np.zeros((1, 2)), np.cumsum(speeds * FINE, axis=0)])
    poses = _poses(speeds)
    rows = [",".join(["encoder_ms", "ticks_right", "ticks_left", "tracker_s", "x_mm", "y_mm", "heading_deg"])]
    ticks = (np.floor(turned * TICKS).astype(int) + FIRST) % WRAP
    read = _read(poses, np.random.default_rng(11))
    for index in range(0, len(times), STEP):
        x, y, heading = read[index]
        encoder = f"{1000 * (times[index] + BEHIND):.0f},{ticks[index, 0]},{ticks[index, 1]}"
        shown = (np.rad2deg(heading) + 180) % 360 - 180
        rows.append(f"{encoder},{times[index]:.2f},{1000 * x:.2f},{1000 * y:.2f},{shown:.3f}")
    return "\n".join(rows) + "\n"


def _poses(speeds: np.ndarray) -> np.ndarray:
    forward = (speeds[:, 0] * TRUTH["wheel_radius_right"] + speeds[:, 1] * TRUTH["wheel_radius_left"]) / 2
    turning = speeds[:, 0] * TRUTH["wheel_radius_right"] - speeds[:, 1] * TRUTH["wheel_radius_left"]
    rate = turning / TRUTH["track"]
    headings = np.concatenate([[0.0], np.cumsum(rate * FINE)])
    middle = headings[:-1] + rate * FINE / 2
    steps = np.column_stack([forward * np.cos(middle), forward * np.sin(middle)]) * FINE
    places = np.vstack([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.column_stack([places, headings])


def _read(poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    # By the target, in a frame of the tracker's own, with its noise.
    ahead, left, turned = SITS
    arm = (ahead + 1j * left) * np.exp(1j * poses[:, 2])
    seen = (poses[:, 0] + 1j * poses[:, 1] + arm) * np.exp(0.4j) + (0.8 - 0.3j)
    clean = np.column_stack([seen.real, seen.imag, poses[:, 2] + turned + 0.4])
    return clean + rng.normal(size=clean.shape) * [NOISE[0], NOISE[0], NOISE[1]]


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
