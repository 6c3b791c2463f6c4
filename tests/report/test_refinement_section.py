"""What the spline costs, as the page says it, beside the starts and the bound."""

from __future__ import annotations

from typing import Any

import pytest
import sample_records
from recorded import record_from
from test_sureness_section import FOUND

from oed.report.sections.refinement import refinement
from oed.report.sections.searches import starts
from oed.report.sections.sureness import sureness


def refined(*shares: float, **changes: Any) -> Any:
    """A record whose search went on to finer splines, each reaching so large a share of its objective."""
    data = sample_records.single().data
    (first, *others) = data["results"]
    best = first["objective"]
    levels = [
        {"coefficients": 3 + 13 * 2**turn, "objective": share * best, "iterations": 100 - turn}
        for turn, share in enumerate(shares)
    ]
    # Its starts were on the first spline.
    begun = [
        {**one, "objective": one["objective"] and shares[0] * one["objective"]} for one in first["starts"]
    ]
    stages = {"starts": shares[0] * best, "refined_spline": best}
    result = {**first, "levels": levels, "starts": begun, "stages": stages}
    return record_from({**data, "results": [result, *others], **changes}), best


def bound_of(value: float, best: float) -> dict[str, Any]:
    return {**FOUND, "upper_bound": value, "best": best, "gap": value / best - 1, "drive": None}


@pytest.mark.slow
def test_gains_and_the_gap_that_they_leave_are_said():
    _, best = refined(1.0)
    record, best = refined(0.9, 0.98, 1.0, certificate=bound_of(1.1 * best, best))
    section = refinement(record)
    (said,) = section.paragraphs
    assert "16 coefficients costs at least 11 %, for that is what 55 coefficients gain" in said
    assert "the last doubling gained 2.0 %" in said
    assert "end up to 10.0 % below the best of them" in said
    assert "22.2 %, refining leaves 10.0 %" in said
    (table,) = section.tables
    assert [row[0] for row in table.rows] == [16, 29, 55]
    assert [row[3] for row in table.rows] == pytest.approx(
        [100 * (1.1 / one - 1) for one in (0.9, 0.98, 1.0)]
    )
    assert [row[4] for row in table.rows] == [100, 99, 98]


def test_without_a_bound_there_is_no_gap():
    record, _ = refined(0.9, 1.0)
    section = refinement(record)
    assert "gap" not in section.paragraphs[0]
    assert len(section.tables[0].columns) == 4


@pytest.mark.parametrize("shares", [(), (1.0,)])
def test_a_search_on_one_spline_has_no_section(shares: tuple[float, ...]):
    data = sample_records.single().data
    assert refinement(record_from(data)) is None
    if shares:
        assert refinement(refined(*shares)[0]) is None


def test_starts_are_compared_with_the_design_on_their_own_spline():
    record, _ = refined(0.8, 1.0)
    made = sureness(record)
    assert "1 of 2 starts came within 1 % of the designed drive on 16 coefficients" in str(made)
    assert "the refined spline reached" in str(starts(record).paragraphs)
