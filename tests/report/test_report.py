"""Reports: every record gets a whole page, and the page says what the record says."""

from __future__ import annotations

import ast
import math
import re
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser
from pathlib import Path

import pytest
import sample_records
from recorded import record_from
from sample_records import RECORDS
from shown_in import column, section

import oed.report
from oed.foundation.errors import UserMistake
from oed.foundation.shown import shown_lines
from oed.kernel.criteria import CRITERIA
from oed.records.record import load_record, save_record
from oed.report import write_report
from oed.report.figures.draw import svg_text
from oed.report.figures.spec import Panel, Plot
from oed.report.page import html_text, markdown_text, sections_of
from oed.robots.limits.workspace import OBSTACLES, WORKSPACES
from oed.robots.models import MODELS
from oed.robots.sensors import SENSORS

pytestmark = pytest.mark.usefixtures("drawn_once")


@pytest.fixture
def written(blank_figures: None, tmp_path: Path) -> Path:
    """Folder of a report on `full`."""
    write_report(sample_records.full(), tmp_path)
    return tmp_path


class Page(HTMLParser):
    """Links, ids and unclosed elements of a page."""

    VOID = frozenset({"input", "meta", "br", "link", "img", "hr"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.links: list[str] = []
        self.open: list[str] = []
        self.tags: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for key, value in attrs:
            if key == "id":
                self.ids.append(value or "")
            if key in ("src", "href", "xlink:href", "srcset"):
                self.links.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


DRAWN = ("many", "sensors", "piecewise_constant")
"""Records that have every figure there is between them: those of the others differ in numbers alone."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", RECORDS)
def test_every_record_gets_a_whole_report(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if kind not in DRAWN:
        request.getfixturevalue("blank_figures")
    record = RECORDS[kind]()
    path = write_report(record, tmp_path)
    assert path == tmp_path / "report.html"

    html = path.read_text(encoding="utf-8")
    page = Page(html)
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    inner = [link for link in page.links if not link.startswith("data:")]
    assert all(link.startswith("#") and link[1:] in page.ids for link in inner)
    assert not {"link", "img", "iframe", "image"} & set(page.tags)
    assert "@import" not in html

    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    if kind in ("sensors", "absolute") or kind.startswith("by_"):
        for said in (text.partition("## Provenance")[0], html.partition("Provenance</h2>")[0]):
            assert not re.search(r"\b(nan|None|inf|undefined|WHEN)\b", said)
            assert all(part.title.split("'")[0] in said for part in sections_of(record)[:-1])
    files = {file.relative_to(tmp_path).as_posix() for file in (tmp_path / "figures").glob("*")}
    assert set(re.findall(r"!\[[^\n]*\]\(([^)]*)\)", text)) == files
    assert page.tags.count("svg") == len(files)
    for name in files:
        assert (tmp_path / name).stat().st_size < 150_000
        ElementTree.parse(tmp_path / name)
    assert "nan" not in re.findall(r"[a-z]+", text)
    assert "None" not in text


@pytest.mark.slow
def test_same_record_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_record(sample_records.piecewise_constant(), tmp_path)
    contents = []
    for name in ("first", "second"):
        write_report(load_record(tmp_path), tmp_path / name)
        # Drawn anew, whatever is kept of the first.
        monkeypatch.setattr("oed.report.page._svg", svg_text)
        files = sorted(file for file in (tmp_path / name).rglob("*") if file.is_file())
        contents.append({file.relative_to(tmp_path / name): file.read_bytes() for file in files})
    assert contents[0] == contents[1]


@pytest.mark.slow
def test_markdown_tables_keep_their_shape(written: Path) -> None:
    text = (written / "report.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    blocks = re.findall(r"(?:^\|.*\n)+", text, flags=re.M)
    tables = [table for part in sections_of(sample_records.full()) for table in part.tables]
    assert len(blocks) == len(tables)
    assert len(rows) == sum(2 + len(table.rows) for table in tables)
    for block, table in zip(blocks, tables, strict=True):
        for line in block.splitlines():
            assert len(re.findall(r"(?<!\\)\|", line)) == len(table.columns) + 1


@pytest.mark.slow
def test_names_from_the_study_are_text_not_markup(written: Path) -> None:
    html = (written / "report.html").read_text(encoding="utf-8")
    assert "<h1>Small &lt;robot&gt; | study</h1>" in html
    assert "<code>bound: true</code> is read, but &lt;not&gt; computed." in html
    text = (written / "report.md").read_text(encoding="utf-8")
    assert text.startswith(r"# Small \<robot\> \| study")


def test_paper_table_holds_the_records_numbers() -> None:
    record = sample_records.full()
    (table,) = section(record, "The paper's figures").tables
    for title, key in (
        ("λ_min", "lambda_min"),
        ("λ_max", "lambda_max"),
        ("cond(W)", "condition_number"),
        ("s_min(W)", "smallest_singular_value"),
    ):
        # JSON holds no infinity: null is that of a regressor that is exactly singular.
        assert column(table, title) == [
            math.inf if value is None else value for value in (getattr(one, key) for one in record.results)
        ]
    first = record.results[0]
    assert column(table, "|y|")[0] == pytest.approx(100 * first.norm_y)
    factor = first.condition_number / (100 * first.norm_y)
    assert column(table, "cond(W)/|y|")[0] == pytest.approx(factor)
    assert table.columns[5].heading == "|y| [cm]"


@pytest.mark.slow
def test_heading_response_is_in_radians_and_a_mixed_one_is_left_out() -> None:
    heading = section(sample_records.full(regressor="heading"), "The paper's figures").tables[0]
    assert "|y| [rad]" in [entry.heading for entry in heading.columns]
    both = section(sample_records.full(regressor="both"), "The paper's figures").tables[0]
    assert not any("|y|" in entry.title for entry in both.columns)


def test_deviations_in_mm_with_their_interval() -> None:
    record = sample_records.single()
    table = section(record, "Predicted standard deviations").tables[0]
    known = record.results[0].standard_deviations
    for row, name in zip(table.rows, ("c21", "c22"), strict=True):
        deviation = known[name]
        assert row[:3] == (name, "mm", pytest.approx(24.5))
        assert row[3:] == (
            pytest.approx(1e3 * deviation),
            pytest.approx(100 * deviation / 0.0245),
            pytest.approx(1960 * deviation, rel=1e-4),
        )


def test_infinite_numbers_are_said() -> None:
    record = sample_records.unbounded_numbers()
    assert section(record, "The paper's figures").tables[0].cells[0][3] == "∞"
    assert section(record, "Predicted standard deviations").tables[0].cells[0][3] == "∞"


def test_limits_in_words() -> None:
    record = sample_records.full()
    by_limit, side_by_side = section(record, "What limits it").tables
    states = {str(row[0]): str(row[-1]) for row in by_limit.rows}
    assert states["rest to rest"] == "met"
    assert states["wheel speed"] == "satisfied with room"
    fast = dict(zip([entry.title for entry in side_by_side.columns], side_by_side.rows[3], strict=True))
    exceeded = next(margin for margin in record.results[3].margins if margin.limit == "wheel_speed")
    assert fast["wheel speed"] == f"exceeded by {-exceeded.margin:.1f} rad/s"


def test_spread_counts_starts_within_one_percent() -> None:
    record = sample_records.single()
    part = section(record, "Spread over the starts")
    assert "1 of 3 starts end within 1 % of the best one; 1 found no feasible design." in part.paragraphs[0]
    assert "keeps 99.9 % of the objective" in part.paragraphs[1]
    best = record.results[0].objective
    assert part.tables[0].rows[0] == (
        "Designed drive (Ipopt)",
        3,
        1,
        0.9 * best,
        pytest.approx(0.95 * best),
        best,
        20,
        30,
        1.5,
    )


def test_summary_of_nothing_feasible_says_what_is_in_the_way() -> None:
    part = section(sample_records.without_drive(), "Summary")
    assert part.paragraphs == (
        "No drive was found that satisfies every limit.",
        "One limit is in the way: wheel speed (by 2.86 rad/s).",
    )
    assert part.notices == ()
    assert part.animation is None


def test_nothing_is_measured_by_a_drive_that_does_not_exist() -> None:
    parts = {one.title: one for one in sections_of(sample_records.only_infeasible_drive())}
    assert parts["Summary"].animation is None
    assert parts["Summary"].paragraphs[0] == "No drive was found that satisfies every limit."
    assert not {"Criteria", "How it compares", "Predicted standard deviations", "What limits it"} & set(parts)
    columns = [column.title for column in parts["Candidates"].tables[0].columns]
    assert not {"efficiency", "repetitions for the same"} & set(columns)
    assert "Efficiency" not in " ".join(parts["Candidates"].paragraphs)


def test_summary_names_the_best_and_shows_the_notes() -> None:
    record = sample_records.full()
    part = section(record, "Summary")
    assert part.notices == tuple(record.data["notes"])
    said = section(record, "Question and search").paragraphs[1]
    assert "Designed drive, the best of 4 results" in said
    assert f"{record.results[0].path_length:.3f} m" in said


def test_without_noise_nothing_is_predicted() -> None:
    record = sample_records.full(noise="{}")
    part = section(record, "Predicted standard deviations")
    assert part.tables == ()
    assert "no noise" in part.paragraphs[0]
    assert "no noise" in section(record, "Summary").paragraphs[1]


def test_study_is_echoed() -> None:
    record = sample_records.single()
    assert section(record, "Provenance").code == record.data["study_text"]


def test_unwritable_folder_is_the_users_mistake(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserMistake):
        write_report(sample_records.empty(), tmp_path / "file")


def test_text_filters() -> None:
    assert html_text("a < `b_c`") == "a &lt; <code>b_c</code>"
    assert html_text("2 m x 3 m") == "2\u00a0m\u00a0x\u00a03\u00a0m"
    assert html_text("1 cm of 12 starts, 5 %") == "1\u00a0cm of 12 starts, 5\u00a0%"
    assert markdown_text("x_y `a_b` *") == r"x\_y `a_b` \*"


@pytest.mark.slow
def test_reports_only_read() -> None:
    # The film of simulated physics simulates; all else is drawn and told from what a record holds.
    allowed = {f"oed.{room}" for room in ("foundation", "kernel", "records", "report", "robots")}
    for file in Path(oed.report.__file__).parent.rglob("*.py"):
        if file.parts[-2:] == ("film", "physics.py"):
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                assert name.split(".")[0] not in ("casadi", "pymoo", "scipy", "loky"), file
                assert "pyplot" not in name, file
                assert not name.startswith("oed") or ".".join(name.split(".")[:2]) in allowed, file


@pytest.mark.slow
def test_reports_ask_the_parts_of_a_study_and_know_none_by_its_kind() -> None:
    parts = (*SENSORS, *CRITERIA, *WORKSPACES, *OBSTACLES, *MODELS)
    # A circle is a baseline too.
    kinds = {part.model_fields["kind"].default for part in parts} - {"circle"}
    assert {"trailer_angle", "modified_E", "rectangle", "tractor_trailer"} <= kinds
    for file in Path(oed.report.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Compare | ast.Dict):
                asked = node.keys if isinstance(node, ast.Dict) else ast.walk(node)
                found = {one.value for one in asked if isinstance(one, ast.Constant)}
                assert not found & kinds, file


STEERING = "\x1b[2J\x9b\u202e\x07"
FREE = ("message", "notes", "unit", "study_text", "violations")
"""Keys of a record under which there may be any text."""


def _steered(value: object, key: str = "") -> object:
    if isinstance(value, dict):
        ending = STEERING * (key == "violations")
        return {name + ending: _steered(one, name) for name, one in value.items()}
    if isinstance(value, list):
        return [_steered(one, key) for one in value]
    return f"{value}{STEERING} $x" if isinstance(value, str) and key in FREE else value


@pytest.mark.slow
def test_nothing_that_steers_reaches_pages_and_figures(tmp_path: Path) -> None:
    record = record_from(_steered(sample_records.many().data))
    write_report(record, tmp_path)
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert shown_lines(text.replace("\t", "")) == text.replace("\t", ""), file
    for name in ("report.md", "report.html"):
        assert r"\x1b[2J\x9b\u202e\x07" in (tmp_path / name).read_text(encoding="utf-8")


def _titled(text: str) -> Plot:
    return Plot([Panel((), title=text)])


@pytest.mark.slow
def test_figures_do_not_steer_and_leave_letters_to_the_viewer() -> None:
    assert r"a\x1b[2J\x9b\u202e\x07 $x" in svg_text(_titled(f"a{STEERING} $x"))
    assert "車輪" in svg_text(_titled("車輪"))
