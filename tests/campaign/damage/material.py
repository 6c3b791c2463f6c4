"""Sound files to be damaged: studies, paths, logs and records, and the commands that read them."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

import oed
from oed.workflow.studies import load_study

from ..generator.studies import draw_study

SHIPPED = Path(__file__).parents[3] / "problems"
STUDIES = {
    "plain": """\
format: 1
name: Plain
robot: {kind: differential_drive, wheel_radius: 4.9 cm, track: 18 cm}
trajectory: {duration: 6 s, samples: 12, spline: {degree: 3, coefficients: 7}}
measurement: {kind: poses, noise: {position: 1 cm, heading: 1 deg}}
limits:
  wheel_speed: 10 rad/s
  wheel_acceleration: 20 rad/s^2
  workspace: {kind: rectangle, x: [-1 m, 1 m], y: [-1 m, 1 m]}
solvers: [{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}]
baselines: [random]
validation: {replicates: 100}
""",
    "runs": """\
format: 1
name: Runs of a coefficient robot   # with a column in the way
robot: {kind: skid_steer, wheel_radius: 49 mm, track: 0.18, slip_outer: 5 %, slip_inner: -2 %}
trajectory: {duration: 6 s, samples: 10, runs: 2, spline: {degree: 2, coefficients: 6}, start: free}
measurement:
  kind: displacements
  segments: 5
  regressor: both
  noise: {position: 1 cm, heading: 1 deg}
estimate: [c11, c12, c21, c22]
limits:
  wheel_speed: {wheel_speed_right: 9 rad/s, wheel_speed_left: [-8 rad/s, 8 rad/s]}
  workspace:
    kind: polygon
    points: [[-1 m, -1 m], [2 m, -1 m], [2 m, 0 m], [0 m, 0 m], [0 m, 2 m], [-1 m, 2 m]]
  obstacles: [{kind: circle, x: 1.3 m, y: -0.5 m, radius: 10 cm}]
  end_position: start
criterion: {kind: D}
prior: {standard_deviations: {c21: 5 %}}
solvers: [{kind: ipopt, starts: 1, perturbations: 0, second_stage: none, max_iterations: 5}]
""",
}
"""Studies whose records are damaged as well."""


@dataclass(frozen=True)
class Target:
    """A file to damage.

    Attributes:
        sort: "study", "path", "log" or "record".
        file: relative to the material's folder.
        commands: command lines that read it; `{out}` stands for a fresh folder.
        quick: those of them that take a fraction of a second.
    """

    sort: str
    file: str
    commands: tuple[tuple[str, ...], ...]
    quick: int


TARGETS = (
    *(
        Target(
            "study",
            f"{name}.yaml",
            (("check", f"{name}.yaml"), ("evaluate", "--json", f"{name}.yaml", f"{name}/ipopt.csv")),
            2,
        )
        for name in STUDIES
    ),
    Target("study", "drawn.yaml", (("check", "drawn.yaml"),), 1),
    Target(
        "study",
        "logged.yaml",
        (
            ("check", "logged.yaml"),
            ("estimate", "--json", "--quiet", "logged.yaml", "log.csv", "--out", "{out}"),
        ),
        1,
    ),
    *(
        Target(
            "path",
            f"{name}/ipopt.csv",
            (("evaluate", "--json", f"{name}.yaml", f"{name}/ipopt.csv", "--designs", "{out}"),),
            1,
        )
        for name in STUDIES
    ),
    Target(
        "log",
        "log.csv",
        (
            ("evaluate", "--json", "logged.yaml", "log.csv", "--designs", "{out}"),
            ("estimate", "--json", "--quiet", "logged.yaml", "log.csv", "--out", "{out}"),
        ),
        1,
    ),
    *(
        Target(
            "record",
            f"{name}/record.json",
            (
                ("export", name, "--to", "csv", "--out", "{out}/drive.csv"),
                ("export", name, "--to", "json", "--out", "{out}/drive.json"),
                ("export", name, "--to", "ros2_yaml", "--out", "{out}/drive.yaml"),
                ("report", name, "--out", "{out}"),
                ("validate", name, "--replicates", "100", "--quiet", "--json"),
            ),
            3,
        )
        for name in STUDIES
    ),
)


def make_material(folder: Path, seed: int) -> None:
    """Write all sound files into a folder: of searches of less than a second, and a log."""
    for name, text in STUDIES.items():
        file = folder / f"{name}.yaml"
        file.write_text(text, encoding="utf-8")
        oed.run(load_study(file), folder / name, seed=0, workers=1)
    drawn = draw_study(np.random.default_rng([seed, 99]))
    (folder / "drawn.yaml").write_text(drawn.text(np.random.default_rng(seed)), encoding="utf-8")
    shutil.copy(SHIPPED / "logs" / "room_robot.csv", folder / "log.csv")
    study = yaml.safe_load((SHIPPED / "room_robot.yaml").read_text(encoding="utf-8"))
    study["name"] = "Logged"
    # Each log that still reads is compared with the bound, which takes long for many samples.
    study["trajectory"]["samples"] = 25
    text = yaml.safe_dump(
        {**study, "calibration": {"covariance": "information", "segment": "log"}}, sort_keys=False
    )
    (folder / "logged.yaml").write_text(text, encoding="utf-8")


def copied(material: Path, folder: Path) -> None:
    """A copy of all sound files, to be damaged."""
    shutil.copytree(material, folder, dirs_exist_ok=True)


def filled(command: Sequence[str], out: Path) -> list[str]:
    """A command line with its folder for results."""
    return [part.replace("{out}", str(out)) for part in command]
