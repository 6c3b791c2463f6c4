"""What a comparison report claims, recomputed from the committed record alone."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from places import REPORTS
from recorded import exceeding, keep_results, record_from
from scipy import stats

from oed.foundation.text import error_text, significant
from oed.kernel.solution import Status, unscored
from oed.records.outcomes import result_of
from oed.records.record import Record, load_record
from oed.records.stored.result import Progress, Result
from oed.report import write_comparison, write_report
from oed.report.answer import best_baseline
from oed.report.contenders import Contender, dots, finding, relative_deviations
from oed.report.figures import ranking, spread
from oed.report.figures.spec import Line
from oed.report.figures.spread import RADIUS_95, ellipse
from oed.report.page import sections_of
from oed.report.parts.judging import repetitions_of
from oed.report.parts.section import Section
from oed.report.sections import SECTIONS
from oed.report.sections.candidates import candidates
from oed.report.sections.searches import convergence, time_to
from oed.report.sections.summary import question, summary
from oed.report.sections.validation import validation

pytestmark = pytest.mark.usefixtures("blank_figures")

UPPER_BOUND = 2 * 10 * (0.18 / 0.049) ** 2


@pytest.fixture(scope="module")
def flagship() -> Record:
    return load_record(REPORTS / "choi_skid_steer")


def entry(record: Record, name: str) -> Result:
    found = record.result(name)
    assert found is not None
    return found


def deviation(one: Result, parameter: str) -> float:
    """From the drive alone: sqrt of the diagonal of sigma^2 (W'W)^-1 by the singular values it reports."""
    return float(one.standard_deviations[parameter])


class TestSummary:
    def test_its_numbers_are_the_records(self, flagship: Record):
        part = summary(flagship)
        best, baseline = flagship.best, best_baseline(flagship)
        drives = [(deviation(baseline, name) / deviation(best, name)) ** 2 for name in ("c21", "c22")]
        low, high = (significant(2)(one) for one in (min(drives), max(drives)))
        said = low if low == high else f"{low} to {high}"
        assert f"As good as {said} drives" in part.paragraphs[1]
        for row, name in zip(part.tables[0].rows, ("c21", "c22"), strict=True):
            assert row[2:] == tuple(f"{error_text(deviation(one, name), 1e3)} mm" for one in (best, baseline))
        said = " ".join(question(flagship).paragraphs)
        assert f"objective of {best.objective:.1f}" in said
        ahead = entry(flagship, "genetic").objective
        more = 100 * (ahead / best.objective - 1)
        assert f"Design 2 reaches {ahead:.1f}, {more:.3f} % more: as good" in said

    def test_the_deviations_bound_each_other_as_they_must(self, flagship: Record):
        # The trace of the covariance is sigma^2 (1 / lambda_min + 1 / lambda_max).
        for name in ("ipopt", "genetic", "square"):
            one = entry(flagship, name)
            trace = sum(deviation(one, parameter) ** 2 for parameter in ("c21", "c22"))
            assert trace == pytest.approx(0.1**2 * (1 / one.lambda_min + 1 / one.lambda_max), rel=1e-9)


class TestCandidates:
    def test_efficiency_is_the_ratio_of_objectives(self, flagship: Record):
        table = candidates(flagship).tables[0]
        best = flagship.best.objective
        for row, one in zip(table.rows, flagship.results, strict=True):
            if row[4] != math.inf:
                assert row[3] == pytest.approx(100 * one.objective / best)
                assert row[4] == pytest.approx(best / one.objective)

    def test_singular_drives_never_suffice(self, flagship: Record):
        singular = entry(flagship, "straight").model_copy(update={"identifiable": False})
        assert repetitions_of(flagship, singular) == math.inf

    def test_no_search_exceeds_the_upper_bound(self, flagship: Record):
        objectives = [one.objective for one in flagship.results if one.feasible]
        assert max(objectives) <= UPPER_BOUND * (1 + 1e-9)
        assert flagship.best.objective >= 0.999 * UPPER_BOUND


class TestConvergence:
    def test_history_never_falls(self, flagship: Record):
        for name in ("ipopt", "genetic"):
            history = entry(flagship, name).history
            for key in ("objective", "seconds", "evaluations"):
                assert np.all(np.diff([getattr(point, key) for point in history]) >= 0)

    def test_time_to_target_reads_the_first_hit(self):
        history = [
            Progress(objective=value, seconds=seconds, evaluations=int(10 * seconds))
            for value, seconds in ((1.0, 1.0), (3.0, 2.0), (5.0, 4.0))
        ]
        found = Result.model_construct(history=history)
        assert time_to(found, 2.0) == (2.0, 20)
        assert time_to(found, 6.0) is None

    def test_the_race_is_told_from_the_history(self, flagship: Record):
        target = entry(flagship, "genetic").history[-1].objective
        hit = time_to(entry(flagship, "ipopt"), target)
        assert hit is not None
        assert re.search(rf"after {hit[0]:.3g}0* s", convergence(flagship).paragraphs[0])


class TestValidation:
    def test_sampled_covariance_agrees_with_the_formula(self, flagship: Record):
        outcome = flagship.data["validation"]
        reach = 4 * math.sqrt(2 / outcome["replicates"])
        for one in outcome["results"]:
            ratios = np.diag(one["sampled_covariance"]) / np.diag(one["promised_covariance"])
            assert np.all(np.abs(ratios - 1) < reach)

    def test_the_verdict_stands_in_the_section(self, flagship: Record):
        section = validation(flagship)
        verdict = next(
            one["verdict"] for one in flagship.data["validation"]["results"] if one["name"] == "ipopt"
        )
        assert any(verdict in paragraph for paragraph in section.paragraphs)

    @pytest.mark.parametrize(("factor", "small"), [(0.3, True), (4.3, False)])
    def test_long_numbers_along_a_square_are_few_and_small(
        self, flagship: Record, factor: float, small: bool
    ):
        pair = [spread.Estimated(name, "error", "1/s", factor, True) for name in ("c21", "c22")]
        (panel,) = spread.clouds([flagship.validation.results[0]], ["Designed"], pair).panels
        assert panel.equal == "box"
        assert panel.x.most == 4
        assert panel.small == small

    def test_the_ellipse_holds_95_percent(self):
        covariance = np.array([[2.0, 0.5], [0.5, 1.0]])
        outline = ellipse([0.0, 0.0], covariance)
        distances = np.einsum("ik,ij,jk->k", outline, np.linalg.inv(covariance), outline)
        np.testing.assert_allclose(distances, RADIUS_95**2)
        assert stats.chi2(2).cdf(RADIUS_95**2) == pytest.approx(0.95, abs=1e-6)


def test_how_baselines_are_driven_stands_beside_them(flagship: Record):
    said = {"circle": "2 laps of 1.11 m.", "square": "2 laps of 0.3 m. It cannot be driven here."}
    silent = Status.SCORED.sentence
    told = [one.model_copy(update={"message": said.get(one.name, silent)}) for one in flagship.results]
    told = [exceeding(one, wheel_speed=0.1) if one.name == "square" else one for one in told]
    (table,) = candidates(flagship.model_copy(update={"results": told})).tables
    place = [column.title for column in table.columns].index("how it is driven")
    assert {row[0]: row[place] for row in table.rows if row[place]} == {"Circle": said["circle"]}


@pytest.mark.slow
def test_every_section_is_made_for_the_flagship(flagship: Record):
    titles = [section.title for section in sections_of(flagship)]
    # The study is not robust, nothing is driven in simulated physics or drifts, all readings are taken, and
    # the spline is given.
    others = {"robustness", "physics", "readings", "drift", "refinement"}
    assert others <= {section.__name__ for section in SECTIONS["robots"]}
    assert len(titles) == len(set(titles)) == len(SECTIONS["robots"]) - len(others)


def test_no_section_needs_more_than_a_search(flagship: Record):
    data = {**flagship.data, "validation": None}
    keep_results(data, "ipopt")
    assert all(isinstance(section, Section) for section in sections_of(record_from(data)))


class TestSeveralRecords:
    @pytest.mark.slow
    def test_differences_and_best_drives_are_listed(self, flagship: Record, tmp_path: Path):
        other = flagship.data
        other["study"]["limits"]["wheel_speed"]["bounds"] = [0.0, 5.0]
        page = write_comparison([("first", flagship), ("second", record_from(other))], tmp_path)
        text = (tmp_path / "report.md").read_text(encoding="utf-8")
        assert page.exists()
        assert "limits.wheel\\_speed.bounds | -10, 10 | 0, 5 |" in text
        assert "trajectory.duration" not in text
        # One room: their paths share a figure and its scale.
        assert {path.name for path in (tmp_path / "figures").iterdir()} == {"paths_1.svg", "precision.svg"}

    @pytest.mark.slow
    def test_records_without_a_design_are_named(self, flagship: Record, tmp_path: Path):
        nothing = {**flagship.data, "best": None}
        keep_results(nothing)
        write_comparison([("first", flagship), ("empty", record_from(nothing))], tmp_path)
        assert "empty: no feasible drive" in (tmp_path / "report.md").read_text(encoding="utf-8")


def scaled_errors(record: Record, factor: float) -> Record:
    """The same with standard errors of the best so many times as large."""
    data = record.data
    for one in data["results"]:
        sizes = one["standard_deviations"]
        one["standard_deviations"] = {name: size and factor * size for name, size in sizes.items()}
    return record_from(data)


class TestFinding:
    def test_the_smallest_of_the_largest_errors_is_the_most_precise(self, flagship: Record):
        some = [Contender(f"times {factor:g}", scaled_errors(flagship, factor)) for factor in (3.0, 1.0, 2.0)]
        title, said = finding(some)
        assert title == "Most precise: times 1"
        largest = max(relative_deviations(flagship).values())
        texts = [f"{significant(2)(factor * largest)} %" for factor in (1, 2, 3)]
        assert [said.index(text) for text in texts] == sorted(said.index(text) for text in texts)
        assert said.index("times 2") < said.index("times 3")
        # Dots: that one on top.
        panel = dots(some).figure.panels[0]
        assert [name for _, name in panel.y.ticks] == ["times 1", "times 2", "times 3"]

    def test_no_winner_where_there_is_no_difference_worth_one(self, flagship: Record):
        some = [Contender(str(factor), scaled_errors(flagship, factor)) for factor in (1.0, 1.02)]
        assert finding(some)[0] == "All 2 are about as precise"

    def test_the_best_by_the_criterion_is_not_called_the_most_precise_where_it_is_not(self, flagship: Record):
        some = [Contender(f"times {factor:g}", scaled_errors(flagship, factor)) for factor in (1.0, 2.0)]
        title, said = finding(some, some[1])
        assert title == "Best by the study's criterion: times 2"
        assert "That of times 1 is smaller" in said
        assert finding(some, some[0]) == finding(some)

    def test_no_winner_where_parameters_differ(self, flagship: Record):
        data = flagship.data
        for one in data["results"]:
            one["standard_deviations"].pop("c22", None)
        some = [Contender("first", flagship), Contender("second", record_from(data))]
        title, said = finding(some)
        assert title == "2 designs side by side"
        assert "not estimate the same parameters" in said
        picture = dots(some)
        assert picture is not None
        # Nor does the figure say so: no dot is filled.
        looks = [part.look for one in picture.figure.panels for part in one.parts if isinstance(part, Line)]
        assert ranking.DESIGN not in looks
        assert "most precise" not in picture.caption

    def test_the_figure_says_what_its_dots_are(self, flagship: Record):
        picture = dots([Contender("first", flagship), Contender("second", scaled_errors(flagship, 2.0))])
        assert picture is not None
        assert [one.title for one in picture.figure.panels] == ["c21", "c22"]
        assert {one.x.label for one in picture.figure.panels} == {"standard error [mm]"}
        assert "the most precise design (filled) on top" in picture.caption

    def test_what_is_not_identifiable_is_never_ahead(self, flagship: Record):
        data = flagship.data
        for one in data["results"]:
            one["standard_deviations"]["c22"] = None
        some = [Contender("open", record_from(data)), Contender("known", scaled_errors(flagship, 50.0))]
        title, said = finding(some)
        assert title == "Most precise: known"
        assert "not identifiable" in said

    @pytest.mark.slow
    def test_names_lead_to_the_reports_that_there_are(self, flagship: Record, tmp_path: Path):
        (tmp_path / "a run").mkdir()
        (tmp_path / "a run" / "report.html").touch()
        sources = {"first": tmp_path / "a run", "second": tmp_path / "none"}
        records = [(name, flagship) for name in sources]
        page = write_comparison(records, tmp_path / "out", sources=sources)
        found = set(re.findall(r'<a href="([^#][^"]*)">([^<]*)', page.read_text()))
        assert found == {("../a%20run/report.html", "first")}


@pytest.mark.slow
def test_the_committed_report_is_what_its_record_gives(flagship: Record, tmp_path: Path):
    write_report(flagship, tmp_path)
    committed = REPORTS / "choi_skid_steer" / "report.md"
    assert (tmp_path / "report.md").read_text("utf-8") == committed.read_text("utf-8")


def test_a_baseline_that_the_robot_cannot_drive_says_why(flagship: Record) -> None:
    square = unscored("square", "baseline", "It cannot turn in place.", Status.IMPOSSIBLE)
    told = [*flagship.results[:1], result_of(square, None)]
    (table,) = candidates(flagship.model_copy(update={"results": told})).tables
    assert "It cannot turn in place." in table.cells[-1][-1]
