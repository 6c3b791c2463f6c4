"""A page's first screen: the drive beside the answer; what can be driven stands apart from what cannot."""

from __future__ import annotations

import base64
import re
from itertools import pairwise
from pathlib import Path

import pytest
import sample_records
import sample_rooms
from places import REPORTS
from recorded import record_from
from shown_in import section

from oed.foundation.errors import UserMistake
from oed.records.record import Record, load_record
from oed.report.answer import best_baseline
from oed.report.figures import ranking
from oed.report.figures.draw import drawn
from oed.report.figures.spec import WIDTH, Line, Note, Panel, Plot
from oed.report.page import render, sections_of
from oed.report.parts.inputs import groups_of, sampled
from oed.report.parts.reading import called, drivable
from oed.report.parts.section import Column, Picture, Section, Table
from oed.report.sections.candidates import candidates, comparison
from oed.report.sections.searches import convergence


@pytest.fixture(scope="module")
def designed() -> Record:
    """A record with a search, a second one as good, a baseline of no use and one that breaks limits."""
    data = sample_records.full().data
    winding, arc, straight, fast = data["results"]
    data["results"] = [
        sample_records.as_search(winding),
        {**sample_records.as_search(arc), "objective": 1.002 * winding["objective"]},
        {**straight, "kind": "baseline"},
        {**fast, "kind": "baseline"},
        {**straight, "kind": "baseline", "name": "straight_same_length"},
    ]
    return record_from({**data, "best": "ipopt"})


@pytest.mark.slow
def test_the_page_begins_with_the_drive_and_the_answer(designed: Record) -> None:
    first, *others = sections_of(designed)
    assert first.first
    assert first.animation is not None
    assert first.title == "Summary"
    assert first.paragraphs[0].startswith("A drive of 4 s in a room")
    assert [row[0] for row in first.tables[0].rows] == ["c21", "c22"]
    assert not any(one.first for one in others)
    node, bag, *_ = first.commands
    assert node[0].startswith("As a ROS 2 node that plays it")
    assert bag == ("As a ROS 2 bag", "oed export . --to rosbag2")
    # A reader without scripts sees the drive as well, also where it is the only one.
    assert [one.name for one in first.figures] == ["best_path"]
    alone = designed.model_copy(update={"results": designed.results[:1]})
    assert [one.name for one in sections_of(alone)[0].figures] == ["best_path"]
    (fold,) = first.folds
    assert fold.title == "What this page assumes"
    assert "differential drive" in fold.paragraphs[0]


def test_the_study_is_named_in_what_is_to_be_typed(designed: Record) -> None:
    def then(record: Record) -> str:
        return sections_of(record)[0].commands[-1][1]

    assert then(designed) == "oed estimate STUDY.yaml LOG.csv"
    data = designed.data
    data["provenance"]["study"] = "mine.yaml"
    assert then(record_from(data)) == "oed estimate mine.yaml LOG.csv"


def test_the_csv_is_that_of_the_record(designed: Record) -> None:
    (csv,) = sections_of(designed)[0].downloads
    head, *rows = csv.content.splitlines()
    assert head == "t,wheel_speed_right,wheel_speed_left,x,y,heading"
    assert len(rows) == 21
    assert designed.best is not None
    assert [float(one) for one in rows[-1].split(",")[3:]] == pytest.approx(designed.best.drive.poses[-1])


def test_drives_are_called_by_what_they_are(designed: Record) -> None:
    names = [called(designed, one) for one in designed.results]
    assert names == ["Designed drive", "Design 2", "Straight", "Fast", "Straight same length"]
    assert [one.name for one in drivable(designed)] == ["ipopt", "arc", "straight"]


def test_only_what_can_be_driven_is_compared_and_played(designed: Record) -> None:
    animation = sections_of(designed)[0].animation
    assert animation is not None
    assert [one["name"] for one in animation.drives] == ["Designed drive", "Design 2", "Straight"]
    part = comparison(designed)
    assert part is not None
    assert part.tables == ()
    panel = part.figures[0].figure.panels[0]
    assert [name for _, name in panel.y.ticks] == ["Designed drive", "Design 2", "Straight"]
    assert sum(isinstance(one, Line) for one in panel.parts) == 1
    assert "not identifiable" in [one.text for one in panel.parts if isinstance(one, Note)]
    # Which of two equals is chosen is said where they are compared.
    assert (
        "Design 2 is 0.20 % better by E than the designed drive, which counts as equal" in part.paragraphs[0]
    )


def test_the_full_table_says_why_a_drive_cannot_be_driven(designed: Record) -> None:
    table = candidates(designed).tables[0]
    why = {row[0]: row[-1] for row in table.rows}
    assert why["Fast"].startswith("exceeds wheel speed by")
    assert "rad/s" in why["Fast"]
    assert why["Designed drive"] is None


@pytest.mark.slow
def test_methods_come_last_and_folded(designed: Record) -> None:
    folded = [one.folded for one in sections_of(designed)]
    assert folded == sorted(folded)
    by_title = {one.title: one.folded for one in sections_of(designed)}
    assert by_title["Candidates"]
    assert by_title["The paper's figures"]
    assert by_title["Provenance"]
    assert not by_title["How it compares"]
    # Without a design they say why there is none.
    assert not any(one.folded for one in sections_of(sample_records.without_drive()))


def test_inputs_are_played_beside_their_limits() -> None:
    record = sample_rooms.crab()
    animation = section(record, "Summary").animation
    assert animation is not None
    assert [one["title"] for one in animation.charts] == ["wheel speed [rad/s]"]
    assert animation.charts[0]["limits"] == (-10.0, 10.0)
    ((values, _),) = groups_of(record, 4)
    for run, played in enumerate(animation.drives[:3]):
        expected = sampled(record.results[0], values, run)
        assert expected.shape == (41, 4)
        for column, shown in zip(expected.T, played["inputs"][0], strict=True):
            assert shown == pytest.approx(column, abs=1e-4)


def test_a_search_is_not_measured_by_a_design_that_cannot_be_driven(designed: Record) -> None:
    history = [{"evaluations": 1, "seconds": 1.0, "objective": 5.0}]
    data = designed.data
    for one in data["results"][:2]:
        one["history"] = history
    data["results"][1].update(feasible=False, history=[{**history[0], "objective": 9.0}])
    part = convergence(record_from(data))
    assert part is not None
    assert [row[0] for row in part.tables[0].rows] == ["Designed drive (Ipopt)"]
    assert "Design 2: left out, as it cannot be driven." in part.paragraphs


def test_long_tables_are_folded_and_details_too(tmp_path: Path) -> None:
    table = Table.of([str(number) for number in range(9)], [Column("number")])
    made = Section("Long", paragraphs=("Seen.", "For those who ask."), tables=(table, table), brief=(1, 1))
    html = render("Page", [made], tmp_path).read_text("utf-8")
    seen, _, details = html.partition("<summary>Details</summary>")
    assert "2 further rows" in seen
    assert seen.count("<td>") == 9
    assert seen.index("<td>6</td>") < seen.index('class="rest"') < seen.index("<td>7</td>")
    assert "For those who ask." not in seen
    assert "further row" not in details
    assert "For those who ask." in (tmp_path / "report.md").read_text("utf-8")


def test_downloads_are_in_the_page(designed: Record, tmp_path: Path) -> None:
    (csv,) = sections_of(designed)[0].downloads
    made = Section("Next", downloads=(csv,), commands=(("Then", "oed check <study>"),))
    html = render("Page", [made], tmp_path).read_text("utf-8")
    found = re.search(r'download="drive.csv" href="data:text/plain;charset=utf-8;base64,([^"]+)"', html)
    assert found is not None
    assert base64.b64decode(found[1]).decode() == csv.content
    assert "<code>oed check &lt;study&gt;</code>" in html


@pytest.mark.slow
def test_figures_are_written_in_further_formats(tmp_path: Path) -> None:
    scale = ranking.Scale("track", "mm", (1.0, 30.0, None), ("1.0", "30", "not identifiable"))
    plot = ranking.ranking(["a", "b", "c"], [True, False, False], [scale])
    assert plot.panels[0].x.logarithmic

    made = [Section("One", folds=(Section("In it", figures=(Picture("dots", "dots", "Dots.", plot),)),))]
    render("Page", made, tmp_path, figures=("pdf", "png"))
    figures = tmp_path / "figures"
    assert (figures / "dots.pdf").read_bytes().startswith(b"%PDF")
    assert (figures / "dots.png").read_bytes().startswith(b"\x89PNG")
    (figures / "mine.png").write_bytes(b"mine")
    render("Page", made, tmp_path)
    # Of the figures as they were nothing is left; what is not the report's stays.
    assert {one.name for one in figures.iterdir()} == {"dots.svg", "mine.png"}
    with pytest.raises(UserMistake, match="expected a list of pdf or png, got gif"):
        render("Page", made, tmp_path, figures=("gif",))


@pytest.mark.slow
def test_a_narrow_figure_stays_narrow(tmp_path: Path) -> None:
    one = Panel((), title="One")
    wide, narrow = (
        Picture(f"w{int(width)}", "a", "b", Plot([one], width=width)) for width in (WIDTH, WIDTH / 2)
    )
    html = render("Page", [Section("Both", figures=(wide, narrow))], tmp_path).read_text("utf-8")
    assert re.findall(r'<svg role="img" style="--share: ([\d.]+)"', html) == ["1", "0.5"]


def test_the_page_calls_no_drive_by_what_found_it(designed: Record) -> None:
    # Only where methods are compared, each beside its drive.
    shown = [one for one in sections_of(designed) if one.title not in ("Provenance", "Convergence")]
    tables = [table for one in shown for table in one.tables]
    cells = [str(cell) for table in tables for row in table.rows for cell in row]
    heads = [text for table in tables for text in (table.caption, *(one.title for one in table.columns))]
    said = [
        text for one in shown for text in (*one.paragraphs, *(picture.caption for picture in one.figures))
    ]
    assert not [text for text in (*cells, *heads, *said) if "ipopt" in text]
    assert [row[:2] for row in candidates(designed).tables[0].rows][:3] == [
        ("Designed drive", "Ipopt"),
        ("Design 2", "Arc"),
        ("Straight", None),
    ]


@pytest.mark.parametrize("widest", [25.0, 90.0, 1e3, 1e5, 1e7])
@pytest.mark.slow
def test_labels_of_a_wide_range_stay_apart(widest: float) -> None:
    scales = [ranking.Scale(f"p{number}", "mm", (0.0013, 0.0013 * widest), ("", "")) for number in range(4)]
    figure = drawn(ranking.ranking(["a", "b"], [True, False], scales))
    figure.canvas.draw()
    ax = figure.axes[0]
    labels = [one for one in ax.get_xticklabels() if one.get_text()]
    low, high = ax.get_xlim()
    boxes = [one.get_window_extent() for one in labels if low <= one.get_position()[0] <= high]
    assert len(boxes) >= 1
    assert all(one.x1 < other.x0 for one, other in pairwise(boxes))


def test_of_a_kind_figures_show_the_baseline_that_the_headline_names() -> None:
    flagship = load_record(REPORTS / "choi_skid_steer")
    plain = flagship.result("figure_eight")
    assert plain is not None
    for share in (0.9, 1.1):
        other = plain.model_copy(
            update={"name": "figure_eight_same_length", "objective": share * plain.worth}
        )
        results = [one for one in flagship.results if "figure_eight" not in one.name]
        record = flagship.model_copy(update={"results": [*results, plain, other]})
        eights = [one.name for one in drivable(record) if one.name.startswith("figure_eight")]
        assert eights == [plain.name if share < 1 else other.name]
        best = best_baseline(record)
        assert best is not None
        assert best.name in eights
        made = comparison(record)
        assert made is not None
        shown = str(made.pictures[0].figure)
        assert "Figure eight" in shown
        assert "same length" not in shown
