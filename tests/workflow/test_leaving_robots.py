"""Robots of any study that leave the workspace: what they are drawn from, and on which drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import random_drive
from studies import small

from oed.kernel.evaluation import evaluate
from oed.kernel.solution import Solution, Status
from oed.study.study import Study
from oed.uncertainty.uncertainty import spread_of
from oed.workflow.departures import departures_on, with_uncertainty
from oed.workflow.studies import parse_study

POSES = "{kind: poses, noise: {position: 1 cm, heading: 1 deg}}"


def estimating(**keys: str) -> Study:
    text = small(**keys).replace(
        "{kind: displacements, segments: 4, noise: {position: 1 cm, heading: 1 deg}}", POSES
    )
    return parse_study(text.replace("scaling: none", "scaling: relative"))


def ranges(study: Study) -> dict[str, float]:
    """Half-widths of what robots are drawn from, as shares of the nominal values."""
    spread = spread_of(with_uncertainty(study).uncertain_system)
    shares = (spread.high - spread.nominal) / spread.nominal
    return dict(zip(spread.names, shares.round(6).tolist(), strict=True))


def solutions(study: Study, *kinds: str) -> list[Solution]:
    drive = random_drive(study.problem, 2, 5.0)
    scored = evaluate(study.problem, drive)
    return [Solution(kind, kind, drive, scored, Status.SCORED) for kind in kinds]


def test_usual_ranges_are_taken_where_the_study_has_none():
    assert ranges(estimating()) == {"wheel_radius_right": 0.02, "wheel_radius_left": 0.02, "track": 0.04}


def test_the_study_has_the_last_word():
    assert ranges(estimating(uncertainty="{track: 1 %}")) == {"track": 0.01}


def test_a_prior_takes_the_place_of_usual_ranges():
    prior = "{standard_deviations: {track: 0.5 %}}"
    assert ranges(estimating(prior=prior)) == {
        "wheel_radius_right": 0.02,
        "wheel_radius_left": 0.02,
        "track": 0.005,
    }


def test_a_prior_that_says_nothing_is_passed_over():
    prior = "{standard_deviations: {track: 50 %}}"
    assert ranges(estimating(prior=prior))["track"] == 0.04


@pytest.mark.slow
def test_baselines_are_simulated_only_where_they_are_the_best():
    study = estimating()
    searched, baseline = solutions(study, "ipopt", "baseline")
    names = [entry.name for entry in departures_on(study, [searched, baseline], searched, 0).results]
    assert names == ["ipopt"]
    names = [entry.name for entry in departures_on(study, [searched, baseline], baseline, 0).results]
    assert names == ["ipopt", "baseline"]


@pytest.mark.slow
def test_paths_of_some_robots_on_the_best_drive_are_kept():
    study = estimating()
    (searched,) = solutions(study, "ipopt")
    stored = departures_on(study, [searched], searched, 0)
    paths = np.array(stored.bundle.paths)
    assert (stored.usual, stored.robust, stored.draws, stored.limits) == (True, False, 1000, ["workspace"])
    assert stored.bundle.name == "ipopt"
    assert paths.shape == (40, 1, 41, 2)
    assert np.ptp(paths[:, 0, -1], axis=0).min() > 0


def test_nothing_is_said_without_limits_on_positions():
    study = estimating()
    kept = [limit for limit in study.problem.limits if limit.name != "workspace"]
    bare = replace(study, problem=replace(study.problem, limits=tuple(kept)))
    assert departures_on(bare, solutions(study, "ipopt"), None, 0) is None


def test_nothing_is_said_without_a_drive():
    assert departures_on(estimating(), [], None, 0) is None
