"""What the answer, the page and the figure say of robots that leave the workspace."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from recorded import record_from
from sample_records import full

from oed.cli.terminal.console import print_answer
from oed.records.record import Record
from oed.report.answer import answer_of
from oed.report.sections.drives import best_path, player
from oed.report.sections.summary import summary

TRACK = {"name": "track", "unit": "m", "nominal": 0.18, "low": 0.171, "high": 0.189, "uniform": True}


def made(share: float | None, **parts: Any) -> Record:
    """The sample record with so many robots that leave on its best drive; None for a record without any."""
    data = full().data
    best = record_from(data).best.name
    paths = np.cumsum(np.random.default_rng(0).normal(0, 0.02, (3, 1, 30, 2)), axis=2).round(4).tolist()
    if share is not None:
        data["departures"] = {
            "usual": True,
            "robust": False,
            "uncertain": [TRACK],
            "limits": ["workspace"],
            "draws": 1000,
            "seed": 0,
            "results": [{"name": best, "share": share, "interval": [0.0, 1.0], "distance": 0.04}],
            "bundle": {"name": best, "leaves": [True, False, False], "paths": paths},
        }
    return record_from({**data, **parts})


def test_records_of_earlier_versions_say_that_limits_are_satisfied():
    record = made(None)
    assert record.departures is None
    assert (answer_of(record).warning, answer_of(record).sentences[-1]) == ("", "Limits satisfied.")


def test_few_robots_that_leave_are_told_of_instead_of_limits():
    record = made(0.003)
    answer = answer_of(record)
    assert answer.warning == ""
    assert record.departures.sentence(record.best.name) in answer.sentences
    assert "Limits satisfied." not in answer.sentences


def test_many_robots_that_leave_are_the_first_line(capsys):
    record = made(0.43)
    answer = answer_of(record)
    assert answer.warning == record.departures.sentence(record.best.name)
    assert answer.warning not in answer.sentences
    assert "Limits satisfied." not in answer.sentences
    print_answer(answer)
    assert capsys.readouterr().out.startswith("Warning: 43 % of 1,000 robots")


@pytest.mark.parametrize(("share", "first"), [(0.003, False), (0.43, True)])
def test_the_page_begins_with_a_warning(share: float, first: bool):
    record = made(share)
    sentence = record.departures.sentence(record.best.name)
    assert (sentence in summary(record).notices[:1]) == first
    assert (sentence in summary(record).paragraphs) != first


def test_robust_studies_have_one_number():
    tried = {
        "name": made(None).best.name,
        "probability": 0.003,
        "interval": [0.002, 0.004],
        "draws": 1000,
        "seed": 0,
        "by_limit": {"workspace": 0.003},
        "farthest": 0.05,
        "objective": 1.0,
        "reserve": 2.5,
        "kept": 0,
    }
    robustness = {
        "kind": "chance",
        "confidence": 0.99,
        "objective": "nominal",
        "limits": ["workspace"],
        "uncertain": [TRACK],
        "results": [tried],
        "bundles": [],
    }
    said = answer_of(made(0.003, robustness=robustness)).sentences
    assert [sentence for sentence in said if "robots" in sentence] == [said[-1]]
    further = {**robustness, "limits": ["workspace", "trailer_angle"]}
    said = answer_of(made(0.003, robustness=further)).sentences
    assert len([sentence for sentence in said if "robots" in sentence]) == 2


def test_the_best_path_is_drawn_with_those_of_other_robots():
    picture, plain = best_path(made(0.003)), best_path(made(None))
    assert len(picture.figure.panels[0].parts) == len(plain.figure.panels[0].parts) + 3
    assert "other robots" in [key.label for key in picture.figure.legend.keys]
    assert "other robots" not in [key.label for key in plain.figure.legend.keys]
    assert "3 simulated robots" in picture.caption
    assert "simulated robots" not in plain.caption


def test_the_player_has_the_paths_of_other_robots_on_the_best_drive_alone():
    best, *others = player(made(0.003)).drives
    assert np.shape(best["robots"]) == (3, 30, 2)
    assert not any(drive["robots"] for drive in others)
    assert not any(drive["robots"] for drive in player(made(None)).drives)
