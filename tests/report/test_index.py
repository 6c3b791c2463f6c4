"""The index of a folder of runs: what is in it, in which order, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import sample_estimates
from recorded import REST
from sample_records import scored, swept
from studies import SMALL
from test_browser import BROWSER, opened

import oed.report.page
from oed.cli import main
from oed.foundation.errors import UserMistake
from oed.foundation.text import deviation_text, fixed
from oed.records.record import load_record
from oed.records.stored.parts import plain
from oed.report.index import runs_in, write_index
from oed.report.page import MOST_ROWS, render
from oed.report.parts.section import Column, Link, Section, Table
from oed.workflow.studies import parse_study

GAP = {"upper_bound": 2.0, "gap": 0.25, "method": "m", "assumptions": []}


def saved(folder: Path, data: dict[str, Any], name: str = "record.json") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(json.dumps(data))
    return folder


def record(finished: str, **more: Any) -> dict[str, Any]:
    provenance = {**REST["provenance"], "finished": finished}
    return {**REST, **scored(), "provenance": provenance, **more}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An old and a new design, deep down; an estimate; a sweep of two; one that cannot be read."""
    folder = tmp_path_factory.mktemp("runs")
    saved(folder / "old", record("2025-01-02T03:04:05+00:00", certificate=GAP))
    (folder / "old" / "report.html").write_text("page")
    saved(folder / "deep" / "down" / "new run", record("2026-11-02T03:04:05+00:00", interrupted=True))
    data = {**plain(sample_estimates.estimate()), "study": parse_study(SMALL).echo()}
    saved(folder / "robot", data, "estimate.json")
    saved(folder / "grid", swept(), "sweep.json")
    for speed in ("5", "10"):
        saved(folder / "grid" / f"wheel_speed_{speed}", record("2024-05-02T03:04:05+00:00"))
    saved(folder / "broken", {"format": 1})
    saved(folder / ".hidden", record("2023-01-02T03:04:05+00:00"))
    (folder / "loop").symlink_to(folder)
    return folder


@pytest.fixture(scope="module")
def page(runs: Path) -> Path:
    return write_index(runs)


def rows(text: str) -> list[list[str]]:
    lines = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return [[re.sub(r"\\", "", cell) for cell in line] for line in lines if not line[0].startswith("-")]


@pytest.mark.slow
def test_every_run_is_a_row_the_newest_first(page: Path):
    heading, *found = rows(page.with_suffix(".md").read_text())
    assert heading[0] == "Study"
    assert [(row[1], row[2], row[6]) for row in found][:3] == [
        ("deep/down/new run", "design, cut short", "2026-11-02 03:04"),
        ("[old](old/report.html)", "design", "2025-01-02 03:04"),
        ("grid", "sweep of 2 points", "2024-05-02 03:04"),
    ]
    assert found[3][1:3] == ["robot", "estimate"]
    assert len(found) == 4


def test_its_numbers_are_the_records(runs: Path):
    found = {run.folder: run for run in runs_in(runs)[0]}
    old, robot = found["old"], found["robot"]
    assert old.gap == 25.0
    assert found["grid"].gap is None
    assert set(old.precision) == {"c21", "c22"}
    data = sample_estimates.estimate()["parameters"][0]
    share = 100 * data["standard_error"] / data["value"]
    assert robot.precision[data["name"]] == pytest.approx(share)


def test_it_says_what_a_run_found_in_the_terms_of_its_study(runs: Path, tmp_path: Path):
    (old,) = [run for run in runs_in(runs)[0] if run.folder == "old"]
    known = load_record(runs / "old")
    assert known.best is not None
    first = known.parameters[0]
    size = known.best.standard_deviations[first.name]
    assert size is not None
    assert old.errors[0] == f"{first.name} {deviation_text(size, first.unit)}"
    data = json.loads((runs / "old" / "record.json").read_text())
    undriven = [{**one, "feasible": False} for one in data["results"]]
    saved(tmp_path / "none", {**data, "best": None, "results": undriven})
    robust = {**data["study"], "uncertainty": {"track": "5 %"}, "robust": {"kind": "chance"}}
    saved(tmp_path / "robust", {**data, "study": robust})
    found = {run.folder: run for run in runs_in(tmp_path)[0]}
    assert found["none"].errors == ("no drive found",)
    assert found["robust"].kind == "robust design"


def test_what_cannot_be_read_is_listed_with_why(page: Path, runs: Path):
    _, unreadable = runs_in(runs)
    assert [name for name, _ in unreadable] == ["broken"]
    assert "record.json" in unreadable[0][1]
    assert unreadable[0][1].split("\n")[0].split(":")[-1] in page.read_text()


def test_names_are_shown_as_they_are(page: Path):
    text = page.read_text()
    assert "Small &lt;robot&gt; | study" in text
    assert "<robot>" not in text
    assert "Small \\<robot\\> \\| study" in page.with_suffix(".md").read_text()


def test_an_index_takes_the_place_of_an_index_alone(runs: Path, tmp_path: Path):
    page = write_index(runs, tmp_path)
    assert write_index(runs, tmp_path) == page
    # Links lead from where the page is.
    (address,) = re.findall(r'href="([^"]*)"', page.read_text())
    assert (tmp_path / address).resolve() == (runs / "old" / "report.html").resolve()
    page.write_text("my own page")
    with pytest.raises(UserMistake, match="it is no index of runs"):
        write_index(runs, tmp_path)
    assert page.read_text() == "my own page"


def test_the_command_makes_one_where_there_is_no_record(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["report", str(runs), "--out", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"report": str(tmp_path / "index.html")}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            {},
            "no run in it or in its folders: expected record.json, estimate.json, sweep.json, plan.json or "
            "loop.json",
        ),
        ({"format": 1}, "none of its 1 runs can be read:\nrun: "),
    ],
)
def test_nothing_to_list_is_the_users_mistake(
    content: dict[str, Any], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    if content:
        saved(tmp_path / "run", content)
    assert main(["report", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "index.html").exists()


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed; the page is not opened")
def test_a_click_on_a_heading_sorts(page: Path, tmp_path: Path):
    clicked = tmp_path / "clicked.html"
    click = "document.querySelectorAll('th button')[5].click();"
    clicked.write_text(page.read_text().replace("</body>", f"<script>{click}</script></body>"))
    elements, console = opened(clicked, "", tmp_path / "profile")
    assert console == []
    # By the gap, which one run has; all others stay in their order behind it.
    body = elements[elements.index("<tbody") :]
    places = [body.index(f">{name}<") for name in ("old", "deep/down/new run", "grid", "robot")]
    assert places == sorted(places)
    assert re.search(r'aria-sort="ascending"[^>]*><button type="button">Gap', elements)


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed; the page is not opened")
def test_sortable_tables_of_pages_sort_by_numbers_and_keep_further_rows_folded(tmp_path: Path):
    sizes = [3.0, None, 20.0, 100.0, 0.5, 7.0, 8.0, 9.0, 1000.0]
    columns = (
        Column("run", cell=lambda one: Link(f"run {one}", "run.html")),
        Column("± track", "mm", fixed(1)),
    )
    page = render("Runs", [Section.of("Runs", Table.of(sizes, columns, sortable=True))], tmp_path)
    clicked = tmp_path / "clicked.html"
    click = "document.querySelectorAll('th button')[1].click();"
    clicked.write_text(page.read_text().replace("</body>", f"<script>{click}</script></body>"))
    elements, console = opened(clicked, "", tmp_path / "profile")
    assert console == []
    bodies = [re.findall(r'data-key="([^"]*)">[^<]*</td>', one) for one in elements.split("<tbody")[1:]]
    shown = [repr(one) for one in sorted(one for one in sizes if one is not None)]
    assert bodies == [shown[:MOST_ROWS], [*shown[MOST_ROWS:], ""]]


def test_colours_of_pages_are_defined_once():
    templates = Path(oed.report.page.__file__).parent / "templates"
    assert not re.search(r"#[0-9a-f]{3,8}\b|--\w+:", (templates / "index.css").read_text())
    defined = re.findall(r"--(\w+):", (templates / "report.css").read_text())
    # In light and in dark, but what both have in common.
    assert max(map(defined.count, defined)) == 2


def test_what_is_for_a_phone_alone_is_not_for_paper():
    templates = Path(oed.report.page.__file__).parent / "templates"
    narrow = [
        line
        for css in templates.glob("*.css")
        for line in css.read_text().splitlines()
        if "max-width: " in line
    ]
    media = [line for line in narrow if line.startswith("@media")]
    assert media
    assert all(line.startswith("@media screen and ") for line in media)
