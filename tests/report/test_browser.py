"""The report's page in a real browser: it renders without console errors, and play moves the robot."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from recorded import record_from
from sample_records import scored
from sample_rooms import crab, towing

from oed.records.record import Record
from oed.report import write_report

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--enable-logging=stderr",
    # Frames are drawn in the page's own time, however busy the machine is.
    "--disable-frame-rate-limit",
    "--disable-threaded-animation",
    "--disable-checker-imaging",
    "--disable-new-content-rendering-timeout",
    "--run-all-compositor-stages-before-draw",
)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed; the page is not opened"),
]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # Of two drives: further ones have the same elements.
    data = scored()
    return write_report(
        record_from({**data, "results": data["results"][:2]}), tmp_path_factory.mktemp("report")
    )


def opened(page: Path, fragment: str, profile: Path) -> tuple[str, list[str]]:
    """The page's elements after a second of its own time, and what it wrote to the console."""
    command = [
        str(BROWSER),
        *FLAGS,
        f"--user-data-dir={profile}",
        "--virtual-time-budget=1000",
        "--dump-dom",
        f"{page.as_uri()}{fragment}",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=90, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


def state(elements: str) -> dict[str, float]:
    """What the player says of itself."""
    tag = re.search(r'<div class="player"[^>]*>', elements)
    assert tag is not None
    return {name: float(value) for name, value in re.findall(r'data-(\w+)="([-\d.]+)"', tag.group())}


@pytest.mark.usefixtures("blank_figures")
@pytest.mark.parametrize(("make", "moved"), [(crab, {"y"}), (towing, {"x", "y", "heading"})])
def test_play_moves_the_robot_and_rooms_bodies_and_trailers_make_no_console_errors(
    make: Callable[[], Record], moved: set[str], tmp_path: Path
) -> None:
    page = write_report(make(), tmp_path / "report")
    elements, console = opened(page, "#play", tmp_path / "profile")
    assert console == []
    # The first run of the crab is sideways.
    assert {name for name, value in state(elements).items() if value} == {"time", *moved}


def with_script(page: Path, script: str, target: Path, media: dict[str, str] | None = None) -> Path:
    """A copy of the page that runs a script when it is there, and other media's rules."""
    text = page.read_text()
    for rule, instead in (media or {}).items():
        assert rule in text
        text = text.replace(rule, instead)
    ending = f'<script>addEventListener("load", function () {{ {script} }});</script></body>'
    target.write_text(text.replace("</body>", ending))
    return target


PRINTED = {"@media print": "@media all", "@media screen": "@media not all"}


def test_paper_has_the_still_picture_and_nothing_to_click(page: Path, tmp_path: Path) -> None:
    script = """const seen = ["canvas.path", ".still svg", ".controls", "details.part", "details[open]"];
      document.querySelector("details.part").open = true;
      const shown = (one) => document.querySelector(one).checkVisibility();
      document.body.dataset.shown = seen.map(shown).join(" ");
      const folded = [...document.querySelectorAll("details:not([open])")];
      document.body.dataset.folded = folded.some((one) => one.checkVisibility());"""
    printed = with_script(page, script, tmp_path / "printed.html", PRINTED)
    elements, console = opened(printed, "", tmp_path / "profile")
    assert console == []
    # A folded part that was opened is printed, those that were not leave no heading behind.
    assert 'data-shown="false true false true true"' in elements
    assert 'data-folded="false"' in elements


def test_paper_is_white_whatever_the_theme(page: Path) -> None:
    dark = re.findall(r"@media ([^{]*prefers-color-scheme: dark[^{]*)\{", page.read_text())
    assert dark
    assert all(one.startswith("screen and ") for one in dark)


@pytest.mark.usefixtures("blank_figures")
def test_a_page_in_a_frame_that_is_not_shown_waits_for_its_room(tmp_path: Path) -> None:
    hidden = write_report(crab(), tmp_path / "report")
    hidden.write_text(hidden.read_text().replace("</head>", "<style>main { display: none; }</style></head>"))
    elements, console = opened(hidden, "", tmp_path / "profile")
    assert console == []
    assert "canvas" in elements


def test_a_narrow_screen_has_the_answer_before_the_inputs_and_a_click_there_sets_the_time(
    page: Path, tmp_path: Path
) -> None:
    # As far as half of the panel: between its margins of 44 and 64 pixels.
    script = """const top = (one) => document.querySelector(one).getBoundingClientRect().top;
      const places = ["canvas.path", ".answer", "canvas.inputs"].map(top);
      const shown = document.querySelector(".player").dataset;
      document.body.dataset.before = [shown.time, shown.x, shown.y, shown.heading].map(Number);
      document.body.dataset.order = places[0] < places[1] && places[1] < places[2];
      const all = document.documentElement;
      document.body.dataset.wide = all.scrollWidth - all.clientWidth;
      const strip = document.querySelector("canvas.inputs"), box = strip.getBoundingClientRect();
      const at = box.left + 44 + (box.width - 108) / 2;
      strip.dispatchEvent(new PointerEvent("pointerdown", {clientX: at, clientY: box.top + 50}));"""
    narrow = with_script(page, script, tmp_path / "narrow.html", {"(max-width: 56rem)": "(min-width: 1px)"})
    elements, console = opened(narrow, "", tmp_path / "profile")
    assert console == []
    assert elements.count("<svg") >= 3
    # At rest where it begins, until the click.
    assert 'data-before="0,0,0,0"' in elements
    assert 'data-order="true"' in elements
    assert 'data-wide="0"' in elements
    assert state(elements)["time"] == pytest.approx(2.0, abs=0.01)
    # The cursor follows the drive.
    cursor = re.search(r'<canvas class="inputs"[^>]*data-time="([^"]*)"', elements)
    assert cursor is not None
    assert float(cursor[1]) == state(elements)["time"]


def test_an_error_in_the_page_would_be_seen(page: Path, tmp_path: Path):
    broken = tmp_path / "broken.html"
    broken.write_text(page.read_text().replace("const context = canvas", "const context = missing"))
    _, console = opened(broken, "", tmp_path / "profile")
    assert any("missing" in line for line in console)
