"""Every pair of a study's extension points: it is solved, or refused in a sentence, never a crash."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import oed
from oed.foundation.errors import FileError
from oed.workflow.studies import load_study

BASE = """\
format: 1
name: A tank that is fed
system:
  kind: equations
  states: {z: 1}
  inputs: {u: ""}
  parameters: {k: 0.5 1/s, g: 1 1/s}
  derivatives: {z: g * u - k * z}
  outputs: {z: z}
experiment:
  duration: 2 s
  samples: 4
  inputs: {u: {range: [0, 1], signal: {kind: piecewise_constant, pieces: 2}}}
measurement: {kind: outputs, noise: {z: 0.1}}
criterion: {kind: D, scaling: none}
solvers: [{kind: ipopt, starts: 1, perturbations: 0, second_stage: none}]
"""
OWN = """\
from typing import Literal

import oed


class Volume(oed.Criterion):
    \"\"\"Log of the determinant, written again.\"\"\"

    kind: Literal["volume"] = "volume"

    def value(self, matrices):
        return oed.D(scaling="none").value(matrices)

    def epigraph(self, matrices):
        return oed.D(scaling="none").epigraph(matrices)
"""
EXTENSIONS: dict[str, dict[str, Any]] = {
    "own criterion": {"criterion": {"kind": "python", "object": "own:Volume", "scaling": "none"}},
    "weights": {"weights": {"total": 3}},
    "weights of trials": {"weights": {"of": "trials", "total": 2, "most": 2}},
    "designed start": {"system.states": {"z": {"design": [0.5, 1]}}},
    "unknown start": {"system.states": {"z": {"unknown": 1}}},
    "prior": {"prior": {"standard_deviations": {"k": "0.1 1/s"}}},
    "several trials": {"experiment.trials": 2},
    "chosen duration": {"experiment.duration": ["1 s", "2 s"]},
    "budget": {"limits": [{"kind": "budget", "name": "fed", "of": "u", "most": "1 s"}]},
    "robust": {
        "uncertainty": {"k": "10 %"},
        "robust": {"kind": "scenarios", "objective": "mean", "draws": 400, "compare": False},
    },
}
"""Keys of each extension of the study above, by their paths."""
REFUSED = {
    ("own criterion", "weights"),
    ("own criterion", "weights of trials"),
    ("weights", "robust"),
    ("weights of trials", "robust"),
}
"""Pairs refused at the key `weights`: a criterion that is not said to be concave, several systems at once."""


def extended(names: tuple[str, ...]) -> str:
    data = yaml.safe_load(BASE)
    for name in names:
        for path, value in EXTENSIONS[name].items():
            *parents, last = path.split(".")
            place = data
            for parent in parents:
                place = place[parent]
            place[last] = value
    return yaml.safe_dump(data, sort_keys=False)


def pairs() -> list[tuple[str, ...]]:
    """Return each extension alone and all pairs; two values of one key are no pair."""
    keys = {name: set(values) for name, values in EXTENSIONS.items()}
    both = [(first, second) for first, second in combinations(keys, 2) if not keys[first] & keys[second]]
    return [*((name,) for name in EXTENSIONS), *both]


def information_by_differences(problem: oed.Problem, drive: oed.Trajectory) -> float:
    """Return log det F of trials from known starts: exact steps, and central differences of the readings."""
    runs, samples = drive.runs, drive.samples // drive.runs

    def read(values: np.ndarray) -> np.ndarray:
        k, g = values
        rows = []
        for run in range(runs):
            state = float(drive.starts[run, 0])
            rows.append(state)
            for u in drive.inputs[run * samples : (run + 1) * samples, 0]:
                state = g * u / k + (state - g * u / k) * np.exp(-k * drive.period)
                rows.append(state)
        return np.array(rows) / 0.1

    nominal = np.array([0.5, 1.0])
    jacobian = np.stack([(read(nominal + h) - read(nominal - h)) / 2e-5 for h in 1e-5 * np.eye(2)], axis=1)
    weights = np.ones(len(jacobian)) if drive.weights is None else drive.weights
    matrix = jacobian.T @ (weights[:, None] * jacobian)
    if problem.prior is not None:
        matrix[0, 0] += 0.1**-2
    return float(np.linalg.slogdet(matrix)[1])


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
@pytest.mark.parametrize("names", pairs(), ids=" + ".join)
def test_pair_is_solved_as_scored_without_the_package_or_refused(tmp_path: Path, names: tuple[str, ...]):
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "study.yaml").write_text(extended(names))
    if names in REFUSED:
        with pytest.raises(FileError) as caught:
            load_study(tmp_path / "study.yaml")
        assert [issue.key for issue in caught.value.issues] == ["weights"]
        return
    study = load_study(tmp_path / "study.yaml")
    solution = oed.solve(study.problem, study.solvers[0], workers=1)
    assert solution.evaluation is not None, solution.detail
    assert np.isfinite(solution.evaluation.objective)
    assert solution.evaluation.feasible, solution.evaluation.violations
    if not {"robust", "unknown start"} & set(names):
        expected = information_by_differences(study.problem, solution.trajectory)
        assert solution.evaluation.objective == pytest.approx(expected, rel=1e-4, abs=1e-4)
