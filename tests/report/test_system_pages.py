"""Pages on systems given by equations: in their own words, and in the units that the study gives."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sample_systems
from recorded import record_from
from shown_in import column, section

from oed.foundation.vocabulary import Vocabulary
from oed.records.record import Record
from oed.report.comparison import write_comparison
from oed.report.contenders import Contender, dots
from oed.report.figures import spec
from oed.report.page import sections_of, write_report
from oed.report.sections.limits import exceeded
from oed.workflow.studies import load_study

OF_ROBOTS = re.compile(
    r"\b(drives?|driven|robots?|rooms?|wheels?|paths?|poses?|turns?|turning|laps?|headings?|in place)\b", re.I
)
CODE = textwrap.dedent("""\
    import oed


    class OwnReactor(oed.ContinuousSystem):
        kind: str = "own_reactor"
        states = ("a",)
        state_units = ("mol/m^3",)
        inputs = (oed.Input("feed", "feed", "mol/m^3/s"),)
        output_units = {"seen": "mol/m^3"}
        parameters = property(lambda self: (oed.Parameter("k", 0.1, "1/s"),))

        def derivative(self, state, inputs, parameters):
            return inputs - parameters[0] * state

        def outputs(self, state, inputs, parameters):
            return {"seen": state[0]}
    """)
BY_CODE = textwrap.dedent("""\
    format: 1
    name: A reactor of one's own
    system: {kind: python, object: "own_reactor:OwnReactor", start: {a: 1 mol/m^3}}
    experiment: {duration: 10 min, samples: 30, inputs: {feed: [0 mol/m^3/s, 0.1 mol/m^3/s]}}
    measurement: {kind: outputs, noise: {seen: 0.01 mol/m^3}}
    """)
MADE = (
    sample_systems.ponds,
    sample_systems.reactions,
    sample_systems.gas,
    sample_systems.parabola,
    sample_systems.trials,
)
DRAWN = (sample_systems.gas, sample_systems.trials)
"""Settings, and readings over time: all the words of other figures are in their descriptions as well."""


@pytest.mark.slow
@pytest.mark.parametrize("made", MADE, ids=lambda made: made.__name__)
def test_a_page_has_no_word_of_robots(
    made: Callable[[], Record], tmp_path: Path, request: pytest.FixtureRequest
):
    """Neither in sentences and tables nor in its figures; what follows from the study is its own."""
    if made not in DRAWN:
        request.getfixturevalue("blank_figures")
    record = made()
    write_report(record, tmp_path)
    for figure in [one.figure for part in sections_of(record) for one in part.pictures]:
        assert not OF_ROBOTS.findall(repr(figure))
    page = (tmp_path / "report.md").read_text().partition("```")[0]
    assert not OF_ROBOTS.findall(re.sub(r"`[^`]*`|\(figures/[^)]*\)", "", page))
    for figure in sorted((tmp_path / "figures").glob("*.svg")) if made in DRAWN else ():
        texts = re.findall(r">([^<>]+)</t(?:ext|span)>", figure.read_text())
        assert texts
        assert not OF_ROBOTS.findall(" ".join(texts))


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_first_screen_has_the_chosen_settings_and_their_weights():
    """What is to be made stands beside what it gives."""
    _, settings = section(sample_systems.parabola(), "Summary").tables
    assert [one.title for one in settings.columns] == ["setting", "x", "weight"]
    assert column(settings, "x") == sorted(column(settings, "x"))
    assert sum(column(settings, "weight")) == pytest.approx(1.0)


@pytest.mark.slow
def test_sections_come_in_the_order_of_the_page():
    """What was asked and found first."""
    titles = [one.title for one in sections_of(sample_systems.ponds())]
    assert titles[0] == "Summary"
    order = [titles.index(one) for one in ("What happens", "Sensitivity of the readings", "What limits it")]
    assert order == sorted(order)


@pytest.mark.slow
def test_records_are_runs_where_they_are_compared(tmp_path: Path):
    """And what they hold is called as on their own pages."""
    record = sample_systems.ponds()
    write_comparison([("first", record), ("second", record)], tmp_path)
    page = (tmp_path / "report.md").read_text()
    assert "Two ponds: which of 2 runs is best?" in page
    assert "| run | experiment | birth \\[1/h\\] |" in page
    assert "| first | 2 trials of 12 h |" in page
    assert not OF_ROBOTS.findall(page)
    # There is neither a regressor nor a length.
    assert "s\\_min" not in page
    assert "length" not in page


def test_names_of_one_letter_are_no_articles():
    """A state a, and an experiment."""
    words = Vocabulary({"a drive": "an experiment", "drive": "experiment"}, ("a", "Drive of a well"))
    assert words.said("A drive; a and the drive; Drive of a well") == (
        "An experiment; a and the experiment; Drive of a well"
    )


@pytest.mark.slow
def test_known_starts_are_no_nuisances():
    """Of two states one is known, beside one that is not."""
    text = sample_systems.PONDS.replace('predators: "0.7"', 'predators: {unknown: "0.7", deviation: "0.1"}')
    held = np.vstack([np.column_stack([sample_systems.FISHING, np.full(24, one)]) for one in (1.2, 0.8)])
    record = sample_systems.scored(text, held, np.array(sample_systems.STARTS), 12 * sample_systems.HOUR)
    (assumed,) = section(record, "Summary").folds
    (said,) = [one for one in assumed.paragraphs if one.startswith("Nuisance")]
    assert said == (
        "Nuisance parameters, estimated as well: the initial predators of trial 1 (prior: ± 0.1) and the "
        "initial predators of trial 2 (prior: ± 0.1)."
    )


@pytest.mark.slow
def test_readings_are_told_by_their_outputs():
    """Their names, and their noise as the study gives it."""
    (assumed,) = section(sample_systems.ponds(), "Summary").folds
    assert (
        "What is read in each trial: prey seen and catch at every sample (25 times) with standard deviations "
        "of 0.02 and 0.01 1/h."
    ) in assumed.paragraphs


@pytest.mark.slow
def test_code_is_not_run_for_a_page(tmp_path: Path):
    """Of a system of one's own, inputs and states are drawn as the record has them, without bands."""
    (tmp_path / "own_reactor.py").write_text(CODE)
    (tmp_path / "study.yaml").write_text(BY_CODE)
    held = np.linspace(0.0, 0.1, 30)[:, None]
    study = load_study(tmp_path / "study.yaml")
    record = sample_systems.scored(study, held, np.array([[1.0]]), 600.0)
    again = record_from(record.data)
    (inputs,) = section(again, "Summary").figures[0].figure.panels
    assert inputs.y.label == "feed [mol/m³/s]"
    (states,) = section(again, "What happens").figures[0].figure.panels
    assert states.x.label == "time [min]"
    (line,) = states.parts
    assert isinstance(line, spec.Line)
    assert line.y[0] == pytest.approx(1.0)
    np.testing.assert_allclose(line.y[-1], record.results[0].drive.by_run[0][-1, 0])
