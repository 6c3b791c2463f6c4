"""How sure it is that a drive is the best: the bound, what it rests on, and every start on one axis."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sample_records
from recorded import record_from

from oed.bounds.certificate import OF_ALL
from oed.report.figures import spread
from oed.report.figures.draw import drawn
from oed.report.sections.first import first
from oed.report.sections.sureness import sureness

OTHER = {"upper_bound": 93.3, "method": "another way", "assumptions": ["the room is left out"]}
FOUND: dict[str, Any] = {
    "upper_bound": 86.7018,
    "gap": 2.1e-5,
    "method": "a way",
    "assumptions": ["one thing", "another"],
    "multiplier": [[0.5, 0.0], [0.0, 0.5]],
    "loose": False,
    "complete": True,
    "best": 86.7,
    "drive": "lattice",
    "spline_objective": 83.3,
    "caps": [{"upper_bound": 86.7018, "method": "a way", "assumptions": []}, OTHER],
    "wall_seconds": 1.0,
}


def record_of(certificate: dict[str, Any], criterion: str = "E") -> Any:
    data = sample_records.scored()
    data["study"]["criterion"]["kind"] = criterion
    return record_from({**data, "results": [], "certificate": certificate})


def section_of(criterion: str = "E", **changes: Any) -> Any:
    return sureness(record_of({**FOUND, **changes}, criterion))


def test_without_a_certificate_there_is_no_section():
    assert sureness(record_from({"results": [], "certificate": None})) is None
    assert sureness(record_from({"results": []})) is None


@pytest.mark.slow
def test_bound_gap_and_assumptions_are_said():
    text = " ".join(section_of().paragraphs)
    for words in (
        "86.7018",
        "a way",
        f"It assumes: {'; '.join(OF_ALL)}; one thing; another.",
        "within 0.0021 %",
        "3.9 % less",
        "Z of",
    ):
        assert words in text
    assert section_of().notices == ()


@pytest.mark.slow
def test_what_every_bound_is_about_is_said_once_of_old_records_and_new():
    for saved in (FOUND["assumptions"], [*OF_ALL, *FOUND["assumptions"]]):
        record = record_of({**FOUND, "assumptions": saved})
        assert record.certificate.assumptions == saved
        assert record.certificate.every_assumption == (*OF_ALL, "one thing", "another")
        page = sample_records.full().model_copy(update={"certificate": record.certificate})
        (fold,) = first(page).folds
        assert " ".join(fold.paragraphs).count("; ".join(OF_ALL)) == 1


@pytest.mark.slow
def test_of_other_criteria_shares_are_in_efficiency():
    numbers = {"upper_bound": 2.002, "best": 2.0, "spline_objective": 1.9}
    text = " ".join(section_of("D", **numbers).paragraphs)
    assert "in efficiency" in text
    assert "λ_min" not in text
    assert f"{100 * (1 - np.exp(-0.1 / 2)):.2g} % less" in text
    numbers = {"upper_bound": -1.99, "best": -2.0, "spline_objective": -2.1}
    assert f"{100 * (1 - 2.0 / 2.1):.2g} % less" in " ".join(section_of("A", **numbers).paragraphs)


def test_a_loose_bound_says_so():
    (notice,) = section_of(loose=True).notices
    assert "loose" in notice


def test_a_search_that_was_ended_is_said():
    assert any("time limit" in text for text in section_of(complete=False).paragraphs)
    assert not any("time limit" in text for text in section_of().paragraphs)


def test_all_bounds_are_listed():
    (table,) = section_of().tables
    assert [row[1] for row in table.rows] == ["a way", "another way"]
    assert section_of(caps=FOUND["caps"][:1]).tables == ()


def test_a_certificate_with_the_agreed_keys_alone_is_enough():
    plain = {key: FOUND[key] for key in ("upper_bound", "gap", "method", "assumptions")}
    section = sureness(record_of(plain))
    assert section is not None
    assert "86.7018" in section.paragraphs[1]
    assert section.brief == (1, 0)
    assert sureness(record_of({**plain, "gap": None})) is not None


def test_percent():
    assert "within 0.001 %" in " ".join(section_of(gap=1e-9).paragraphs)
    assert "within 21 %" in " ".join(section_of(gap=0.21).paragraphs)


def strip_of(kind: str, **changes: Any) -> Any:
    """The strip's picture of a sample record, and its axes."""
    data = getattr(sample_records, kind)().data
    made = sureness(record_from({**data, **changes}))
    assert made is not None
    (picture,) = made.figures
    (ax,) = drawn(picture.figure).axes
    return made, picture, ax


def dots(ax: Any, size: float) -> list[float]:
    lines = (one for one in ax.lines if one.get_marker() == "o" and one.get_markersize() == size)
    return [float(value) for line in lines for value in line.get_xdata()]


STARTS, DESIGNS = (one["markersize"] for one in (spread.START, spread.DESIGN))


def test_starts_and_the_design_stand_below_the_bound_on_one_axis():
    best = sample_records.single().results[0].objective
    certificate = {**FOUND, "upper_bound": 1.25 * best, "best": best, "gap": 0.25, "drive": None}
    made, picture, ax = strip_of("single", certificate=certificate)
    assert ax.get_xlabel() == "efficiency, share of the proved bound [%]"
    # The third start found no feasible design.
    assert dots(ax, STARTS) == pytest.approx([72.0, 80.0])
    assert dots(ax, DESIGNS) == pytest.approx([80.0])
    (bound,) = (one for one in ax.lines if one.get_linewidth() == spread.BOUND["linewidth"])
    assert bound.get_xdata() == pytest.approx([100.0, 100.0])
    assert (
        ax.get_title()
        == "The designed drive reaches 80 % of the proved bound; 1 of 2 starts came as far, to 1 %"
    )
    assert picture.caption.endswith("Left out: 1 start without a feasible design.")
    assert made.brief == (1, 0)


def test_without_a_bound_the_best_is_the_measure_and_the_page_says_what_to_add():
    made, _, ax = strip_of("single")
    assert dots(ax, STARTS) == pytest.approx([90.0, 100.0])
    assert ax.get_xlabel() == "efficiency, share of the best [%]"
    assert ax.get_title() == "1 of 2 starts came within 1 % of the designed drive"
    assert made.paragraphs == (
        "How much better a drive could be is not known: `bound: true` in the study asks for a proof.",
    )


@pytest.mark.slow
def test_a_design_below_its_best_start_says_why():
    """A second stage gives up some of what the starts reached."""
    result = sample_records.single().data["results"][0]
    starts = [{**one, "objective": one["objective"] and 1.01 * one["objective"]} for one in result["starts"]]
    results = [{**result, "starts": starts, "stages": {"second_stage": result["objective"]}}]
    _, picture, _ = strip_of("single", results=results)
    assert "The designed drive gave up 0.99 % of what its best start reached" in picture.caption
    _, picture, _ = strip_of("single")
    assert "gave up" not in picture.caption


@pytest.mark.slow
def test_starts_by_another_criterion_are_left_out_and_named():
    _, picture, ax = strip_of("sensors")
    assert len(dots(ax, STARTS)) == 2
    assert [one.get_text() for one in ax.get_yticklabels()] == ["Designed drive", "Design 2"]
    assert "Left out: starts of Design 2, which sought something else: another criterion" in picture.caption


def test_starts_with_all_readings_do_not_compare_with_a_choice_of_some():
    """Of a drive that is designed first, and read at its best moments only."""
    data = sample_records.single().data
    (result, *_) = data["results"]
    sizes = {"size": 1.0, "weight": 1.0, "relaxed": 1.0, "derivative": 1.0}
    reading = {"sensor": "poses", "run": 0, "time": 1.0, **sizes}
    budget = {"readings": [0], "total": 1.0, "most": 1.0}
    numbers = {"value": 1.0, "relaxed": 1.0, "bound": 1.0, "efficiency": 1.0}
    result["selection"] = {"whole": True, "budgets": [budget], "readings": [reading], **numbers}
    for before, drawn_at_all in ((7.0, False), (1.0, True)):
        result["stages"] = {"starts": before * result["objective"]}
        made = sureness(record_from(data))
        assert made is not None or not drawn_at_all
        assert bool(made is not None and made.figures) is drawn_at_all


def test_rounds_of_a_robust_search_with_limits_not_tight_enough_are_left_out():
    data = sample_records.single().data
    data["study"]["uncertainty"] = {"track": 0.05}
    data["study"]["robust"] = {"kind": "chance"}
    starts = data["results"][0]["starts"]
    starts[1]["objective"] = 1.5 * starts[0]["objective"]
    made = sureness(record_from(data))
    assert "Left out: 1 start better than the design, under limits that were not" in made.figures[0].caption


def test_a_criterion_without_efficiency_is_shown_by_its_number():
    data = sample_records.single().data
    data["study"]["criterion"] = {"kind": "modified_E"}
    made = sureness(record_from(data))
    (ax,) = drawn(made.figures[0].figure).axes
    assert dots(ax, DESIGNS) == pytest.approx([data["results"][0]["objective"]])


@pytest.mark.parametrize("count", [1, 5, 40, 3000])
def test_dots_of_equal_starts_stand_one_above_the_other_within_a_bounded_height(count: int):
    lane = spread.Lane("Designed drive", 90.0, "90 %", tuple(np.linspace(89.9999, 90.0, count)))
    figure = spread.strip([lane], spread.spec.Axis("efficiency"), 100.0, "as it is")
    (ax,) = drawn(figure).axes
    (starts,) = (one for one in ax.lines if one.get_markersize() == STARTS and one.get_marker() == "o")
    assert len(starts.get_xdata()) == count
    assert max(starts.get_ydata()) == min(count, spread.MOST_LEVELS)
    assert figure.height < 4
