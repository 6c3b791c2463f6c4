"""A small trial from end to end: dead reckoning by an oracle, what is recorded, workers and interrupts."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from oracle import advance
from recorded import record_from
from trials import STUDY, small_trial, study_of, tried

from benchmarks.acceptance import floors_of, goals
from oed.foundation.errors import UserMistake
from oed.optimize import Silent
from oed.records.recorded_study import recorded_study
from oed.simulation.physics import FourWheels, drive
from oed.simulation.trial.candidates import candidates
from oed.simulation.trial.experiment import exact_log, prediction_errors
from oed.simulation.trial.options import paced_baseline
from oed.study.study import Study
from oed.workflow.runner import run
from oed.workflow.studies import parse_study

FITS = ["differential drive", "lag", "differential drive by two stage"]
DRIVES = ["optimal for differential drive", "optimal for lag", "circle", "random"]


@pytest.mark.slow
def test_predictions_are_dead_reckoning_with_the_encoders():
    study = study_of()
    planned = paced_baseline(study.problem, "random", 5)
    motion = drive(FourWheels(step=0.001), planned.inputs, planned.period, start=(0.1, -0.2, 2.5))
    model = candidates(study.problem, study.file.physics)[0]
    fitting = model.fitting(study.file.physics.calibration, "joint")
    right, left, track = values = np.array([0.0488, 0.0491, 0.33])
    pose, path = motion.poses[0], [motion.poses[0]]
    for turned, period in zip(np.diff(motion.wheel_angles, axis=0), np.diff(motion.times), strict=True):
        ways = turned * [right, left] / period
        pose = advance(pose, (ways.mean(), 0.0, (ways[0] - ways[1]) / track), period, "arc")
        path.append(pose)
    off = np.hypot(*(np.array(path) - motion.poses)[:, :2].T)
    end, along = prediction_errors(fitting, exact_log(motion), values)
    assert end == pytest.approx(off[-1], rel=1e-6)
    assert along == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-6)
    assert end > 0.001


@pytest.mark.slow
def test_everything_is_recorded():
    data = small_trial()
    (floor,) = data["floors"]
    assert not data["interrupted"]
    assert [fit["name"] for fit in data["fits"]] == FITS
    assert [entry["name"] for entry in data["planned"]] == DRIVES
    assert [entry["model"] for entry in data["planned"]] == ["differential drive", "lag", None, None]
    assert floor["done"] == 3
    assert len(set(floor["drawn"])) == 3
    assert [(entry["drive"], entry["fit"]) for entry in floor["errors"]] == [
        (drive, fit) for drive in DRIVES for fit in FITS
    ]
    for entry in floor["errors"]:
        if entry["refused"] == 0:
            assert entry["value"] == pytest.approx(np.median(entry["each"]), abs=1e-6)
            assert entry["low"] <= entry["value"] <= entry["high"]
            assert entry["along"] > 0
    assert set(floor) == {"friction", "done", "drawn", "errors", "scatter", "attainable", "paths"}
    assert set(floor["paths"]) == set(DRIVES)


@pytest.mark.slow
def test_scatter_is_that_of_the_estimates():
    data = small_trial()
    (floor,) = data["floors"]
    sizes = {fit: np.array([0.049, 0.049, 0.32]) for fit in FITS}
    sizes["lag"] = np.array([0.049, 0.049, 0.32, 0.01])
    for entry in floor["scatter"]:
        values = np.array(entry["each"])
        expected = values.std(axis=0, ddof=1) / sizes[entry["fit"]]
        np.testing.assert_allclose(entry["relative"], expected, rtol=1e-3, atol=1e-7)
        assert entry["total"]["value"] == pytest.approx(np.sqrt(np.mean(expected**2)), rel=1e-3)
    # A slipping robot turns as if its wheels stood much farther apart, and a random drive tells.
    entry = next(one for one in floor["scatter"] if (one["drive"], one["fit"]) == (DRIVES[0], FITS[0]))
    assert 0.30 < entry["mean"][2] < 0.35


@pytest.mark.slow
def test_the_same_whatever_the_number_of_workers():
    assert _timeless(small_trial()) == _timeless(tried(workers=2))


def _timeless(data: dict[str, Any]) -> dict[str, Any]:
    return {**data, "planned": [{**entry, "wall_seconds": 0} for entry in data["planned"]]}


class Impatient(Silent):
    """Interrupts after so many robots."""

    def __init__(self, patience: int) -> None:
        self.patience = patience

    def advance(self, note: str = "") -> None:
        """Count down."""
        self.patience -= 1
        if self.patience == 0:
            raise KeyboardInterrupt


@pytest.mark.slow
@pytest.mark.parametrize(("patience", "errors"), [(1, False), (2, True)])
def test_an_interrupted_trial_keeps_what_was_done(patience: int, errors: bool):
    data = tried(progress=Impatient(patience))
    (floor,) = data["floors"]
    assert data["interrupted"]
    assert floor["done"] == patience
    assert bool(floor["errors"]) == errors
    if errors:
        whole = small_trial()["floors"][0]["errors"]
        firsts = [entry["each"][:2] for entry in whole]
        assert [entry["each"] for entry in floor["errors"]] == firsts


def test_without_the_engine_a_run_is_refused_at_once(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    study = parse_study(STUDY)
    with pytest.raises(UserMistake, match=r"oed\[physics\]"):
        run(study, workers=1)


@pytest.mark.slow
def test_a_study_runs_its_trial_on_the_designs_that_it_finds():
    text = STUDY.replace("repeats: 3", "repeats: 2").replace("models:", "models: []")
    text = "".join(line for line in text.splitlines(keepends=True) if "skid_steer_slip" not in line)
    study: Study = parse_study(text)
    data = run(study, workers=1).data
    planned = data["physics"]["planned"][0]
    best = next(one for one in data["results"] if one["kind"] == "ipopt")
    assert planned["path_length"] == pytest.approx(best["path_length"])
    assert planned["promised"] == pytest.approx(best["standard_deviations"])
    assert recorded_study(record_from(data)).file.physics == study.file.physics


@pytest.mark.slow
def test_an_optimal_drive_calibrates_a_slipping_robot_better_than_everyday_paths():
    text = STUDY.replace("duration: 6 s, samples: 60", "duration: 12 s, samples: 60")
    text = text.replace("coefficients: 8", "coefficients: 12").replace(
        "{kind: D}", "{kind: E, scaling: relative}"
    )
    text = text.replace("repeats: 3", "repeats: 8")
    text = text.replace("[circle, random]", "[circle, slow_square]").replace("methods: [two_stage]", "")
    text = "".join(line for line in text.splitlines(keepends=True) if "models" not in line)
    text = "".join(line for line in text.splitlines(keepends=True) if "skid_steer_slip" not in line)
    (floor,) = floors_of(run(parse_study(text)).data["physics"])
    ratios = {(goal.kind, goal.other[0]): goal.found.value for goal in goals(floor)}
    assert ratios["scatter", "slow square"] <= 0.5
    assert ratios["error", "slow square"] < 1
    # The circle is driven to by turning in place, which tells of the track.
    assert ratios["error", "circle"] <= 0.5
