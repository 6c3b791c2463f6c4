"""The report on robots other than the nominal one: what may differ, how many leave, what it costs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from recorded import record_from
from sample_records import full

from oed.foundation.text import chance_text
from oed.records.record import Record
from oed.report import write_report
from oed.report.answer import answer_of
from oed.report.figures.draw import drawn
from oed.report.sections.candidates import candidates
from oed.report.sections.limits import exceeded
from oed.report.sections.robustness import robustness

pytestmark = pytest.mark.usefixtures("blank_figures")

TRACK = {"name": "track", "unit": "m", "nominal": 0.18, "low": 0.171, "high": 0.189, "uniform": True}
SLIP = {"name": "slip_outer", "unit": "", "nominal": 0.0, "low": -0.1, "high": 0.1, "uniform": False}
ONE_SIDED = {**TRACK, "low": 0.17, "high": 0.2}
HEADING = {**SLIP, "name": "heading, run 2", "unit": "rad", "low": -0.02, "high": 0.02, "uniform": True}


def result(name: str, **changes: Any) -> dict[str, Any]:
    return {
        "name": name,
        "probability": 0.0031,
        "interval": [0.0021, 0.0044],
        "draws": 10_000,
        "seed": 7,
        "by_limit": {"workspace": 0.0031},
        "farthest": 0.052,
        "objective": 80.0,
        "reserve": None,
        "kept": None,
        **changes,
    }


def bundle(name: str, leaves: list[bool]) -> dict[str, Any]:
    paths = np.cumsum(np.random.default_rng(0).normal(0, 0.02, (len(leaves), 1, 30, 2)), axis=2)
    return {"name": name, "leaves": leaves, "paths": paths.round(4).tolist()}


def told(**changes: Any) -> dict[str, Any]:
    """Changes with only those bundles of which there is a result."""
    return {"bundles": [], **changes} if "results" in changes else changes


def made(**changes: Any) -> Record:
    """The winding drive as the robust search's, the arc as what was found without back-off."""
    data = full().data
    data["results"] = data["results"][:2]
    data["results"][1]["name"] = "nominal"
    data["best"] = "ipopt"
    objectives = [one["objective"] for one in data["results"]]
    data["robustness"] = {
        "kind": "chance",
        "confidence": 0.99,
        "objective": "nominal",
        "limits": ["workspace"],
        "uncertain": [TRACK],
        "results": [
            result("ipopt", reserve=2.576, kept=0, objective=objectives[0]),
            result("nominal", probability=0.874, objective=2 * objectives[0], farthest=0.31),
        ],
        "bundles": [bundle("ipopt", [False] * 5), bundle("nominal", [True, False, True])],
        **changes,
    }
    return record_from(data)


def text_of(**changes: Any) -> str:
    section = robustness(made(**told(**changes)))
    assert section is not None
    return " ".join(section.paragraphs)


class TestWords:
    @pytest.mark.slow
    def test_limits_checked_at_points_only_are_named(self):
        entry = result("ipopt", reserve=2.576, checked_at_points=["workspace"])
        assert "Of workspace this was checked at points only" in text_of(results=[entry])
        assert "points only" not in text_of()

    def test_a_robot_without_a_finite_path_is_told(self):
        entries = [result("ipopt", reserve=2.576), result("nominal", farthest=None, probability=0.2)]
        record = made(results=entries, bundles=[])
        section = robustness(record)
        assert section is not None
        assert "the worst has no finite path" in " ".join(section.paragraphs)
        assert section.tables[0].rows[1][4] is None

    @pytest.mark.slow
    def test_a_study_that_is_not_robust_has_no_section(self):
        assert robustness(full()) is None
        assert robustness(record_from({**full().data, "robustness": None})) is None

    def test_without_any_drive_there_is_no_section(self):
        assert robustness(made(results=[], bundles=[])) is None

    @pytest.mark.slow
    def test_what_may_differ_is_said(self):
        assert "track ± 9 mm (5 % of nominal)" in text_of()
        assert "track 170 mm to 200 mm" in text_of(uncertain=[ONE_SIDED])
        assert "(standard deviation)" in text_of(uncertain=[SLIP])
        assert "% of nominal)" not in text_of(uncertain=[SLIP])

    def test_every_run_has_its_own_start(self):
        assert "run 2" in text_of(uncertain=[TRACK, HEADING])

    def test_how_many_leave_is_said(self):
        text = text_of()
        for words in (
            "31 of 10,000 simulated robots",
            "0.21 % to 0.44 %",
            "a back-off of 2.58 standard deviations",
        ):
            assert words in text

    @pytest.mark.parametrize(
        ("kind", "words"),
        [("chance", "some standard deviations"), ("scenarios", "at the corners")],
    )
    def test_the_way_of_keeping_limits_is_said(self, kind: str, words: str):
        (sentence,) = (one for one in text_of(kind=kind).split(". ") if one.startswith("So every limit"))
        assert words in sentence

    def test_robots_added_are_said(self):
        text = text_of(kind="scenarios", results=[result("ipopt", reserve=2.576, kept=4)])
        assert "4 of the worst robots added" in text
        assert "standard deviations" not in text

    @pytest.mark.parametrize(("objective", "word"), [("mean", "mean over"), ("worst", "worst of")])
    def test_another_objective_is_said(self, objective: str, word: str):
        assert word in text_of(objective=objective)
        assert word not in text_of()

    def test_the_cost_is_said(self):
        text = text_of()
        assert "50.0 % of nominal" in text
        assert "87.40 % of the robots" in text

    @pytest.mark.parametrize(
        "results",
        [
            [result("ipopt", reserve=2.576, kept=0)],
            [result("ipopt", reserve=2.5, kept=0), result("nominal", objective=None)],
        ],
    )
    def test_a_cost_that_is_not_known_is_not_said(self, results: list[dict[str, Any]]):
        assert "What it costs" not in text_of(results=results)

    def test_no_search_kept_enough_in(self):
        assert "No search ended" in text_of(results=[result("nominal")], bundles=[])


class TestTable:
    def test_every_drive_has_a_row(self):
        (table,) = robustness(made()).tables
        assert [row[0] for row in table.rows] == ["Designed drive", "nominal"]
        assert table.rows[0][2:] == (pytest.approx(0.31), "0.21 to 0.44", pytest.approx(5.2), 10_000)

    def test_an_objective_without_a_number_is_left_empty(self):
        (table,) = robustness(made(results=[result("nominal", objective=None)], bundles=[])).tables
        assert table.rows[0][1] is None


class TestFigures:
    def test_bundles_are_drawn_each_in_a_panel(self):
        (picture,) = robustness(made()).figures
        assert "5 robots" in picture.caption
        figure = drawn(picture.figure)
        titles = [ax.get_title() for ax in figure.axes if ax.get_title()]
        assert [title.split(":")[0] for title in titles] == ["Designed drive", "nominal"]
        labels = [text.get_text() for text in figure.legends[0].get_texts()]
        assert {"nominal robot", "satisfies the limits", "violates them"} <= set(labels)

    def test_without_bundles_there_is_no_figure(self):
        assert robustness(made(bundles=[])).figures == ()


@pytest.mark.slow
def test_it_is_in_the_report(tmp_path):
    write_report(made(), tmp_path)
    for name in ("report.html", "report.md"):
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert "Robots other than the nominal one" in text
        assert "violation probability" in text


def test_what_a_tightened_limit_is_exceeded_by_is_said_to_include_its_back_off():
    data = made().data
    (entry,) = [one for one in data["results"] if one["name"] == "nominal"]
    (margin,) = [one for one in entry["margins"] if one["limit"] == "workspace"]
    margin.update(margin=-0.376, kept=False)
    entry.update(feasible=False, violations={"workspace": 0.376})
    record = record_from(data)
    said = "workspace by 376 mm (back-off for other robots included)"
    nominal = record.result("nominal")
    assert exceeded(nominal, record.robustness) == [said]
    assert exceeded(nominal) == ["workspace by 376 mm"]
    rows = {row[0]: row for row in candidates(record).tables[0].rows}
    assert rows["nominal"][-1] == f"exceeds {said}"


@pytest.mark.parametrize(
    ("share", "said"),
    [(0.0, "0.00 %"), (0.00037, "0.04 %"), (0.9389, "93.89 %"), (0.00002, "0.002 %"), (1.0, "100.00 %")],
)
def test_a_probability_is_written_in_one_way(share: float, said: str):
    assert chance_text(share) == said
    record = made(results=[result("ipopt", reserve=2.576, interval=[0.0, share])], bundles=[])
    sentence = f"At most {said} of robots like this one would violate the limits (97.5 % confidence)."
    assert sentence in answer_of(record).sentences
    assert "at any time, by more than 0.1 % of the limit's size." in " ".join(robustness(record).paragraphs)
    assert f"0.31 %; with 95 % confidence 0.00 % to {said}" in " ".join(robustness(record).paragraphs)
