"""A small trial from end to end: dead reckoning by an oracle, record, workers, interrupts, and its report."""

from __future__ import annotations

import copy
import sys
from typing import Any

import numpy as np
import pytest
from oracle import advance
from recorded import record_from
from trials import STUDY, driven_once, small_trial, study_of, tried

from benchmarks.acceptance import floors_of, goals
from oed.foundation.errors import UserMistake
from oed.optimize import Silent
from oed.records.recorded_study import recorded_study
from oed.report.figures.draw import svg_text
from oed.report.parts.section import Section
from oed.report.sections.physics import BEST, physics
from oed.simulation.physics import FourWheels, drive
from oed.simulation.trial import run as trial_run
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
    assert floor["done"] == 2
    assert len(set(floor["drawn"])) == 2
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
def test_an_excess_is_what_a_calibration_has_more_and_never_negative():
    (floor,) = small_trial()["floors"]
    least = {one["fit"]: np.array(one["each"]) for one in floor["attainable"]}
    assert all((values > 0).all() for values in least.values())
    for one in floor["errors"]:
        each = np.array(one["excess_each"], dtype=float)
        if one["refused"] == 0:
            assert (each >= 0).all()
            assert one["excess"]["value"] == pytest.approx(np.median(each), abs=1e-6)
            # Of two held-out drives, the root mean square and the median of root mean squares.
            both = np.median(each + least[one["fit"]])
            assert one["along"] <= both * (1 + 1e-3)


@pytest.mark.slow
def test_the_same_whatever_the_number_of_workers():
    # Two robots, one for each worker.
    text = STUDY.replace("duration: 6 s, samples: 60", "duration: 3 s, samples: 30")
    text = text.replace("repeats: 3", "repeats: 2").replace("held_out: 2", "held_out: 1")
    text = text.replace("[circle, random]", "[random]").replace("  methods: [two_stage]\n", "")
    assert _timeless(tried(text)) == _timeless(tried(text, workers=2))


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
def test_an_interrupted_trial_keeps_what_was_done(
    monkeypatch: pytest.MonkeyPatch, patience: int, errors: bool
):
    monkeypatch.setattr(trial_run, "repeated", driven_once)
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
@pytest.mark.usefixtures("few_screened")
def test_a_study_runs_its_trial_on_the_designs_that_it_finds():
    text = STUDY.replace("duration: 6 s, samples: 60", "duration: 3 s, samples: 30")
    text = text.replace("repeats: 3", "repeats: 2").replace("held_out: 2", "held_out: 1")
    text = text.replace("models:", "models: []").replace("[circle, random]", "[circle]")
    text = "".join(
        line
        for line in text.splitlines(keepends=True)
        if "skid_steer_slip" not in line and "methods" not in line
    )
    study: Study = parse_study(text)
    data = run(study, workers=1).data
    planned = data["physics"]["planned"][0]
    best = next(one for one in data["results"] if one["kind"] == "ipopt")
    assert planned["path_length"] == pytest.approx(best["path_length"])
    assert planned["promised"] == pytest.approx(best["standard_deviations"])
    assert recorded_study(record_from(data)).file.physics == study.file.physics


@pytest.mark.slow
@pytest.mark.usefixtures("few_screened")
def test_an_optimal_drive_calibrates_a_slipping_robot_better_than_everyday_paths():
    text = STUDY.replace("duration: 6 s, samples: 60", "duration: 9.6 s, samples: 48")
    text = text.replace("repeats: 3", "repeats: 2")
    text = text.replace("coefficients: 8", "coefficients: 12").replace(
        "{kind: D}", "{kind: E, scaling: relative}"
    )
    text = (
        text.replace("held_out: 2", "held_out: 1")
        .replace("[circle, random]", "[circle, slow_square]")
        .replace("methods: [two_stage]", "")
    )
    text = "".join(line for line in text.splitlines(keepends=True) if "models" not in line)
    text = "".join(line for line in text.splitlines(keepends=True) if "skid_steer_slip" not in line)
    (floor,) = floors_of(run(parse_study(text), workers=1).data["physics"])
    ratios = {(goal.kind, goal.other[0]): goal.found.value for goal in goals(floor)}
    assert ratios["scatter", "slow square"] <= 0.5
    assert ratios["error", "slow square"] < 1
    # The circle is driven to by turning in place, which tells of the track.
    assert ratios["error", "circle"] <= 0.5


# --- its section of the report ---


def section_of(data: dict[str, Any] | None) -> Section | None:
    return physics(record_from({"physics": data, "results": [], "study": study_of().echo()}))


@pytest.fixture(scope="module")
def shown() -> Section:
    section = section_of(small_trial())
    assert section is not None
    return section


def test_records_without_a_trial_have_no_section():
    assert section_of(None) is None
    assert physics(record_from({"results": [], "study": {}})) is None


@pytest.mark.slow
def test_the_least_error_is_marked(shown: Section):
    errors = small_trial()["floors"][0]["errors"]
    least = min((one for one in errors if one["value"] is not None), key=lambda one: one["value"])
    table = shown.tables[0]
    marked = [(row[0], index) for row in table.cells for index, cell in enumerate(row) if BEST in cell]
    fits = [column.title for column in table.columns]
    assert [(drive, fits[index]) for drive, index in marked] == [(least["drive"], least["fit"])]
    row = next(row for row in table.cells if row[0] == least["drive"])
    assert f"{1000 * least['value']:.3g}" in row[fits.index(least["fit"])]


@pytest.mark.slow
def test_excess_errors_stand_below_what_the_models_leave_themselves(shown: Section):
    (floor,) = small_trial()["floors"]
    first, *others = shown.tables[1].cells
    assert first[0] == "the held-out drives themselves, exactly"
    for place, one in enumerate(floor["attainable"], start=1):
        assert f"{1000 * one['value']:.3g}" in first[place]
        own = [error["excess"]["value"] for error in floor["errors"] if error["fit"] == one["fit"]]
        marked = [BEST in row[place] for row in others]
        known = [np.inf if value is None else value for value in own]
        if np.isfinite(min(known)):
            assert marked.index(True) == int(np.argmin(known))
            assert sum(marked) == 1


@pytest.mark.slow
def test_scatter_stands_beside_what_noise_alone_would_make_of_it(shown: Section):
    rows = {row[1]: row for row in shown.tables[-1].rows}
    assert 0.01 < rows["random"][-1] < 10
    # A circle that is driven to by turning in place makes all of them identifiable, with less precision.
    assert 0.01 < rows["circle"][-1] < 10


@pytest.mark.slow
def test_an_interrupted_trial_says_so():
    data = {**small_trial(), "interrupted": True}
    section = section_of(data)
    assert section is not None
    assert "interrupted; of 2 robots each, 2 at friction 0.6 had driven" in section.notices[0]
    empty = {"friction": 0.6, "done": 0, "errors": [], "scatter": []}
    section = section_of({**data, "floors": [empty]})
    assert section is not None
    assert section.tables == ()
    assert "too few" in section.notices[0]


@pytest.mark.slow
def test_drives_that_break_the_limits_are_named():
    data = copy.deepcopy(small_trial())
    data["planned"][2]["feasible"] = False
    section = section_of(data)
    assert section is not None
    assert "Left out, as they violate the limits or were not found: circle." in section.notices[0]


@pytest.mark.slow
def test_figures_are_drawn(shown: Section):
    texts = [svg_text(picture.figure) for picture in shown.figures]
    assert "held-out error [mm]" in texts[0]
    assert all(name in texts[0] for name in ("lag", "circle", "friction 0.6"))
    assert "planned" in texts[1]


@pytest.mark.slow
def test_two_floors_are_shown_side_by_side():
    data = small_trial()
    other = {**copy.deepcopy(data["floors"][0]), "friction": 0.9}
    section = section_of({**data, "floors": [*data["floors"], other]})
    assert section is not None
    assert len(section.tables) == 5
    assert "friction 0.9" in str(section.figures[0].figure)
