"""Pages on systems given by equations: in their own words, and in the units that the study gives."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import sample_systems
from shown_in import column, section

from oed.records.record import Record
from oed.report.contenders import Contender, dots
from oed.report.page import sections_of, write_report
from oed.report.sections.limits import exceeded

OF_ROBOTS = re.compile(
    r"\b(drives?|driven|robots?|rooms?|wheels?|paths?|poses?|turns?|turning|laps?|headings?|in place)\b", re.I
)
MADE = (sample_systems.ponds, sample_systems.reactions, sample_systems.gas, sample_systems.parabola)


@pytest.mark.parametrize("made", MADE, ids=lambda made: made.__name__)
def test_a_page_has_no_word_of_robots(made: Callable[[], Record], tmp_path: Path):
    """Neither in sentences and tables nor in its figures; what follows from the study is its own."""
    write_report(made(), tmp_path)
    page = (tmp_path / "report.md").read_text().partition("```")[0]
    assert not OF_ROBOTS.findall(re.sub(r"`[^`]*`|\(figures/[^)]*\)", "", page))
    for figure in sorted((tmp_path / "figures").glob("*.svg")):
        texts = re.findall(r">([^<>]+)</t(?:ext|span)>", figure.read_text())
        assert texts
        assert not OF_ROBOTS.findall(" ".join(texts))


def test_errors_are_in_the_units_of_the_study():
    """Every table of a parameter is in 1/h, not in 1/s."""
    record = sample_systems.ponds()
    best = record.best
    assert best is not None
    error = best.standard_deviations["birth"]
    assert error is not None
    table = section(record, "Predicted standard deviations").tables[0]
    assert column(table, "unit") == ["1/h"] * 4
    assert column(table, "nominal")[0] == pytest.approx(1.0)
    assert column(table, "standard deviation")[0] == pytest.approx(3600 * error)
    summary = section(record, "Summary").tables[0]
    assert all(cell.endswith(" 1/h") for cell in column(summary, "standard error, designed experiment"))


def test_limits_are_in_the_units_of_the_study():
    """What a limit is exceeded by as well."""
    record = sample_systems.ponds()
    table = section(record, "What limits it").tables[0]
    sizes = dict(zip(column(table, "limit"), column(table, "size of the limit"), strict=True))
    assert sizes["fishing"] == "1 1/h"
    assert sizes["many"] == "9"
    assert sizes["duration"] == "24 h"
    result = record.results[0]
    margin = next(one for one in result.margins if one.limit == "fishing")
    beyond = margin.model_copy(update={"margin": -0.5 / 3600, "satisfied": False})
    broken = result.model_copy(update={"margins": [beyond]})
    assert exceeded(broken, None, record.study.limit_units) == ["fishing by 0.500 1/h"]


def test_several_are_compared_in_the_units_of_the_study():
    """The axes of dots and the columns of tables."""
    some = [Contender(name, sample_systems.ponds()) for name in ("a", "b")]
    picture = dots(some)
    assert picture is not None
    labels = [panel.x.label for panel in picture.figure.panels] + [one.title for one in picture.figure.panels]
    assert any("1/h" in one for one in labels)
    assert not any("1/s" in one for one in labels)


def test_sections_come_in_the_order_of_the_page():
    """What was asked and found first."""
    titles = [one.title for one in sections_of(sample_systems.ponds())]
    assert titles[0] == "Summary"
    assert titles.index("What happens") < titles.index("What readings tell") < titles.index("What limits it")
