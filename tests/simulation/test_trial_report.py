"""The report's section on a trial: tables with the best marked, figures."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from recorded import record_from
from trials import small_trial, study_of

from oed.report.figures.draw import svg_text
from oed.report.parts.section import Section
from oed.report.sections.physics import BEST, physics

pytestmark = pytest.mark.slow


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


def test_the_least_error_is_marked(shown: Section):
    errors = small_trial()["floors"][0]["errors"]
    least = min((one for one in errors if one["value"] is not None), key=lambda one: one["value"])
    table = shown.tables[0]
    marked = [(row[0], index) for row in table.cells for index, cell in enumerate(row) if BEST in cell]
    fits = [column.title for column in table.columns]
    assert [(drive, fits[index]) for drive, index in marked] == [(least["drive"], least["fit"])]
    row = next(row for row in table.cells if row[0] == least["drive"])
    assert f"{1000 * least['value']:.3g}" in row[fits.index(least["fit"])]


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


def test_scatter_stands_beside_what_noise_alone_would_make_of_it(shown: Section):
    rows = {row[1]: row for row in shown.tables[-1].rows}
    assert 0.01 < rows["random"][-1] < 10
    # A circle that is driven to by turning in place makes all of them identifiable, with less precision.
    assert 0.01 < rows["circle"][-1] < 10


def test_an_interrupted_trial_says_so():
    data = {**small_trial(), "interrupted": True}
    section = section_of(data)
    assert section is not None
    assert "interrupted; of 3 robots each, 3 at friction 0.6 had driven" in section.notices[0]
    empty = {"friction": 0.6, "done": 0, "errors": [], "scatter": []}
    section = section_of({**data, "floors": [empty]})
    assert section is not None
    assert section.tables == ()
    assert "too few" in section.notices[0]


def test_drives_that_break_the_limits_are_named():
    data = copy.deepcopy(small_trial())
    data["planned"][2]["feasible"] = False
    section = section_of(data)
    assert section is not None
    assert "Left out, as they violate the limits or were not found: circle." in section.notices[0]


def test_figures_are_drawn(shown: Section):
    texts = [svg_text(picture.figure) for picture in shown.figures]
    assert "held-out error [mm]" in texts[0]
    assert all(name in texts[0] for name in ("lag", "circle", "friction 0.6"))
    assert "planned" in texts[1]


def test_two_floors_are_shown_side_by_side():
    data = small_trial()
    other = {**copy.deepcopy(data["floors"][0]), "friction": 0.9}
    section = section_of({**data, "floors": [*data["floors"], other]})
    assert section is not None
    assert len(section.tables) == 5
    assert "friction 0.9" in svg_text(section.figures[0].figure)
