"""Drives of a trial that are designed for its task, or with noise that knows what a model cannot say."""

from __future__ import annotations

import numpy as np
import pytest
from trials import STUDY, study_of, tried

from oed.foundation.errors import StudyError
from oed.kernel.criteria import I
from oed.records.stored.simulation import StoredTrial
from oed.report.sections.physics import SAY
from oed.robots.sensors.pose_noise import Discrepancy
from oed.simulation.trial.aims import aims
from oed.simulation.trial.candidates import candidates
from oed.simulation.trial.options import held_out_drives
from oed.workflow.studies import parse_study

NUMBERS = "  discrepancy: {position_per_speed: 20 ms}\n"
PILOT = "  discrepancy: {pilot: random}\n"
TASK = "  task: true\n"


def issue_of(text: str):
    with pytest.raises(StudyError) as caught:
        parse_study(text)
    (issue,) = caught.value.issues
    return issue


def aims_of(text: str):
    study = study_of(STUDY + text)
    trial = study.physics
    model = candidates(study.problem, trial)[1]
    fitting = model.fitting(trial.calibration, trial.calibration.method)
    return study.problem, list(aims(study.problem, trial, model, fitting, seed=0))


@pytest.mark.slow
def test_the_task_is_the_held_out_drives_themselves():
    problem, (optimal, task) = aims_of(TASK)
    assert optimal.model.problem.criterion.kind == "D"
    criterion = task.model.problem.criterion
    assert isinstance(criterion, I)
    drives = held_out_drives(problem, 2, 0)
    for one, drive in zip(criterion.task, drives, strict=True):
        assert np.allclose(one.inputs, drive.inputs)
        assert one.period == drive.period


@pytest.mark.slow
@pytest.mark.parametrize(("text", "name"), [("", "optimal"), (TASK, "for the task")])
def test_a_discrepancy_is_designed_with_and_not_calibrated_with(text, name):
    _, found = aims_of(text + NUMBERS)
    assert [one.name for one in found[-2:]] == [name, f"{name} with discrepancy"]
    plain, noisier = (one.model.problem.sensors[0].noise for one in found[-2:])
    assert plain.discrepancy is None
    assert noisier.discrepancy == Discrepancy(position_per_speed=0.02)
    assert noisier.of_sensor == plain
    assert found[-1].model.problem.criterion == found[-2].model.problem.criterion


@pytest.mark.slow
def test_a_pilot_drive_shows_the_discrepancy_that_slip_leaves():
    _, (_, found) = aims_of(PILOT)
    assert found.discrepancy is not None
    sizes = found.discrepancy.model_dump()
    assert max(sizes.values()) > 1e-3
    assert max(sizes.values()) < 0.2


@pytest.mark.slow
def test_a_trial_drives_them_and_says_so():
    # Two robots are the fewest whose errors are compared, over one held-out drive.
    text = STUDY.replace("duration: 6 s, samples: 60", "duration: 3 s, samples: 30")
    text = text.replace("repeats: 3", "repeats: 2").replace("held_out: 2", "held_out: 1")
    found = tried(
        text.replace("  methods: [two_stage]\n", "").replace("[circle, random]", "[random]") + TASK + PILOT
    )
    names = [one["name"] for one in found["planned"]]
    models = ("differential drive", "lag")
    assert names == [
        *(
            name
            for model in models
            for name in (
                f"optimal for {model}",
                f"for the task by {model}",
                f"for the task with discrepancy by {model}",
            )
        ),
        "random",
    ]
    assert [one["criterion"] for one in found["planned"][:3]] == ["D", "I", "I"]
    assert {one["drive"] for one in found["floors"][0]["errors"]} == set(names)
    said = SAY("drives", StoredTrial.model_validate(found).planned)
    assert "differential drive by D and lag by D" in said
    assert "by criterion I: for the task by differential drive and for the task by lag" in said
    size = found["planned"][2]["discrepancy"]["heading_per_speed"]
    assert size == pytest.approx(0.184, rel=0.05)
    assert f"heading per speed {size:.2g} rad s/m" in said.partition(" by differential drive (")[2]
    assert "lag. Designed with noise" in said
    # A pilot may show none.
    found["planned"][2]["discrepancy"] = dict.fromkeys(found["planned"][2]["discrepancy"], 0.0)
    said = SAY("drives", StoredTrial.model_validate(found).planned)
    assert "by differential drive (none that the pilot drive shows)" in said


@pytest.mark.parametrize(
    ("text", "key", "said"),
    [
        ("  discrepancy: {pilot: spiral}\n", "physics.discrepancy.pilot", "expected one of"),
        ("  discrepancy: {record: pilot}\n", "physics.discrepancy.record", "unknown key"),
        ("  discrepancy: {}\n", "physics.discrepancy", "a number above 0"),
        ("  task: [mine.csv]\n", "physics.task", "true or false"),
    ],
)
def test_what_makes_no_sense_is_refused(text, key, said):
    issue = issue_of(STUDY + text)
    assert (issue.key, issue.line) == (key, STUDY.count("\n") + 1)
    assert said in issue.message


def test_two_discrepancies_are_refused():
    noise = "noise: {position: 1 cm, heading: 1 deg"
    issue = issue_of(STUDY.replace(noise, f"{noise}, discrepancy: {{position_per_speed: 1 ms}}") + NUMBERS)
    assert (issue.key, issue.line) == ("physics.discrepancy", STUDY.count("\n") + 1)
    assert "leave out one" in issue.message


def test_they_are_keys_of_physics_alone():
    for name in ("task", "discrepancy"):
        issue = issue_of(STUDY[: STUDY.index("physics:")] + f"{name}: true\n")
        assert issue.key == name
        assert "physics" in issue.message
