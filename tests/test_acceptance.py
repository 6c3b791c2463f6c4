"""The project's goals for drives on slipping robots, judged from saved records."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import REPORTS

from benchmarks.acceptance import Floor, Goal, floors_of, goals, main, resampled_pair
from oed.records.record import load_record
from oed.simulation.trial.outcome import Interval, Repeats, scatter, total

TRIAL = REPORTS / "physics_skid_steer"


def floor_of(errors: np.ndarray, **other: Any) -> Floor:
    """A floor of drives a, b, ... calibrated by fits 0, 1, ...; errors (repeats, drives, fits)."""
    drives, fits = ("abcdefgh"[: errors.shape[1]], "0123"[: errors.shape[2]])
    given = {"optimal": {}, "values": {}, "scales": {}, "drives": tuple(drives), **other}
    return Floor(friction=0.5, fits=tuple(fits), repeats=Repeats(errors, 4000, seed=1), **given)


@pytest.mark.slow
def test_medians_from_a_record_are_those_of_the_trial():
    # Those of the record were found as it ran.
    trial = load_record(TRIAL).data["physics"]
    for saved, floor in zip(trial["floors"], floors_of(trial), strict=True):
        found = []
        for one in saved["errors"]:
            median = floor.repeats.median(floor.drives.index(one["drive"]), floor.fits.index(one["fit"]))
            found.append((median.value, median.low, median.high))
        expected = [(one["value"], one["low"], one["high"]) for one in saved["errors"]]
        # Errors are saved to a tenth of a micrometre.
        np.testing.assert_allclose(found, expected, rtol=2e-4)


@pytest.mark.slow
def test_a_missed_goal_is_printed_and_fails(capsys: pytest.CaptureFixture[str]):
    assert main([str(TRIAL)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 30
    assert lines[0].endswith("0.71 (0.57 to 0.91), at most 0.5: missed")
    assert any(
        line.endswith("0.45 (0.41 to 0.51), at most 0.5: met, not by all of the interval") for line in lines
    )


def test_a_record_without_a_trial_is_refused(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as stop:
        main([str(REPORTS / "choi_skid_steer")])
    assert stop.value.code == 2
    assert f"{Path('choi_skid_steer')}: no trial" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("found", "met", "sure"),
    [((0.3, 0.2, 0.4), True, True), ((0.48, 0.4, 0.6), True, False), ((0.7, 0.6, np.inf), False, True)],
)
def test_verdicts_follow_the_numbers(found: tuple[float, float, float], met: bool, sure: bool):
    goal = Goal("error", 0.5, ("a", "0"), ("b", "0"), Interval(*found), 0.5)
    assert (goal.met, goal.sure) == (met, sure)
    assert ("met" in str(goal)) == met
    assert ("not by all" in str(goal)) != sure


def test_ratios_of_the_same_repeats():
    errors = np.stack([[[1.0, 4.0], [2.0, 8.0]], [[3.0, 5.0], [6.0, 10.0]], [[2.0, 6.0], [4.0, 12.0]]])
    floor = floor_of(errors)
    # Twice as large in every repeat is twice as large in every resample.
    assert floor.ratio([("a", "0")], [("b", "0")]) == Interval(0.5, 0.5, 0.5)
    assert floor.ratio([("a", "1"), ("b", "0")], [("a", "0")]).value == 2.0


def test_the_best_is_chosen_anew_in_every_resample():
    floor = floor_of(np.random.default_rng(0).lognormal(size=(15, 6, 1)))
    one, many = [("a", "0")], floor.cells(floor.drives)
    assert max(floor.ratio(many, one).value, floor.ratio(many, one).high) <= 1
    assert floor.ratio(many, many).high == 1.0


def test_what_was_refused_is_no_error_to_compare_with():
    errors = np.ones((3, 2, 1))
    errors[:, 1] = np.inf
    named = {"drives": ("optimal", "circle"), "optimal": {"0": "optimal"}}
    assert goals(floor_of(errors, **named)) == []
    (error, best) = goals(floor_of(np.ones((3, 2, 1)), **named))
    assert (error.kind, best.kind) == ("error", "best")


def test_ratios_of_scatter_by_the_same_repeats():
    rng = np.random.default_rng(4)
    one = rng.normal(size=(30, 3))
    picks = Repeats(one[:, :, None], 4000, seed=1).picks

    def judged(values: np.ndarray) -> np.ndarray:
        return total(scatter(values, np.ones(3)))

    exact = resampled_pair(one, 2 * one + 5, picks, judged)
    assert exact.low == pytest.approx(0.5)
    assert exact.high == pytest.approx(0.5)
    other = resampled_pair(one, rng.normal(size=(30, 3)), picks, judged)
    assert other.low < 1 < other.high
