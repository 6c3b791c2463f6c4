"""Films of drives: the robot is where the record says, at the time that the clock says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from shutil import copy

import numpy as np
import pytest
import sample_records
from PIL import Image
from places import REPORTS
from recorded import record_from
from sample_rooms import crab, omni, steered, towing

import oed
from oed.foundation.errors import RecordError, UserMistake
from oed.records.record import Record, save_record
from oed.report import write_report
from oed.report.figures.driven import view_of
from oed.report.film.cast import PAUSE, Cast, motion
from oed.report.film.stage import FACE, TRACE, Stage
from oed.report.film.writing import FORMATS, Frame, film_rate
from oed.report.parts.reading import called

QUICK = {"speed": 8.0, "fps": 5.0}
HASTY = {"speed": 50.0, "fps": 2.0}
"""For films that are embedded or named, not looked at."""


def looks_like(frame: Frame, colour: str) -> np.ndarray:
    """Rows and columns of the pixels of exactly a colour, (n, 2)."""
    wanted = [int(colour[place : place + 2], 16) for place in (1, 3, 5)]
    return np.argwhere((frame == wanted).all(axis=2))


@cache
def stage_of(make: Callable[[], Record]) -> Stage:
    """Of the best drive, as fast as it is."""
    record = make()
    return Stage(record, [record.best], 1.0)


class TestMotion:
    def test_it_goes_along_the_arcs_between_samples(self):
        angle = np.linspace(0.0, 5.0, 6)
        poses = np.column_stack([2 * np.sin(angle), 2 - 2 * np.cos(angle), angle])
        found = motion(poses, 10.0)
        np.testing.assert_allclose(np.hypot(found.poses[:, 0], found.poses[:, 1] - 2), 2.0, rtol=1e-12)
        np.testing.assert_allclose(np.diff(found.poses[:, 2]), 0.05, rtol=1e-9)
        assert found.duration == 10.0

    def test_sideways_arcs_too(self):
        angle = np.linspace(0.0, -3.0, 4)
        poses = np.column_stack([np.cos(angle), np.sin(angle), angle + 1.0])
        np.testing.assert_allclose(np.hypot(*motion(poses, 1.0).poses[:, :2].T), 1.0, rtol=1e-12)

    @pytest.mark.slow
    @pytest.mark.parametrize("make", [crab, towing, omni])
    def test_it_passes_every_sample(self, make):
        entry = make().best
        for run, poses in zip(Cast.of(entry).runs, entry.drive.by_run, strict=True):
            times = np.linspace(0.0, 8.0, len(poses))
            found = np.array([run.at(time) for time in times])
            np.testing.assert_allclose(found, poses[:, : found.shape[1]], atol=1e-9)

    @pytest.mark.slow
    def test_the_path_grows(self):
        run = Cast.of(towing().best).runs[0]
        lengths = [np.hypot(*np.diff(run.until(time), axis=0).T).sum() for time in np.linspace(0, 8, 9)]
        assert lengths[0] == 0
        assert (np.diff(lengths) > 0).all()
        np.testing.assert_array_equal(run.until(8.0)[-1], run.poses[-1, :2])


class TestCast:
    @pytest.mark.slow
    def test_runs_follow_each_other_after_a_rest(self):
        cast = Cast.of(crab().best)
        assert cast.length(2.0) == pytest.approx(3 * 4 + 2 * PAUSE)
        moments = [cast.moment(time, 2.0) for time in (0.0, 1.0, 4.0 + PAUSE / 2, 4.0 + PAUSE + 1.0, 99.0)]
        assert moments == [(0, 0.0), (0, 2.0), (0, 8.0), (1, pytest.approx(2.0)), (2, 8.0)]


class TestStage:
    @pytest.mark.slow
    def test_a_drive_is_called_what_the_page_calls_it(self):
        record = oed.load_record(REPORTS / "choi_skid_steer")
        (panel,) = Stage(record, [record.best], 1.0)._panels
        assert panel._ax.get_title(loc="left") == "Designed drive"

    @pytest.mark.slow
    @pytest.mark.parametrize("make", [steered, towing, omni], ids=["steered", "towing", "omni"])
    def test_the_robot_is_where_the_record_says(self, make):
        record = make()
        stage = stage_of(make)
        width, height = view_of(record, [record.best]).size
        first = Cast.of(record.best).runs[0]
        places = {}
        for time in (0.0, 8.0):
            rows, columns = looks_like(stage.frame(time), FACE["facecolor"]).mean(axis=0)
            places[time] = np.array([columns, -rows])
        moved = places[8.0] - places[0.0]
        expected = first.at(8.0)[:2] - first.at(0.0)[:2]
        # One scale for both directions; the middle of the triangle is not the robot's origin.
        box = stage._panels[0]._ax.get_window_extent()
        scale = box.width / width
        assert scale == pytest.approx(box.height / height, rel=1e-6)
        assert np.hypot(*(moved / scale - expected)) < 0.3 * stage._panels[0]._half

    @pytest.mark.slow
    def test_the_trace_grows(self):
        stage = stage_of(towing)
        seen = [len(looks_like(stage.frame(time), TRACE["color"])) for time in (0.0, 2.0, 4.0, 8.0)]
        assert seen == sorted(seen)
        assert seen[-1] > 200

    @pytest.mark.slow
    def test_a_frame_does_not_depend_on_those_before(self):
        stage = stage_of(crab)
        early = stage.frame(3.0)
        stage.frame(20.0)
        np.testing.assert_array_equal(stage.frame(3.0), early)

    @pytest.mark.slow
    def test_size_is_even(self):
        assert not any(side % 2 for side in stage_of(steered).frame(0.0).shape[:2])


@pytest.mark.slow
class TestAnimate:
    def test_the_best_drive_in_the_records_folder(self, tmp_path: Path):
        save_record(towing(), tmp_path)
        made = oed.animate(tmp_path, **QUICK)
        assert (made.file, made.results) == (tmp_path / "drive.gif", ("ipopt",))
        with Image.open(made.file) as image:
            image.load()
            assert image.format == "GIF"
        # 8 s at eight times its speed, and a rest.
        assert made.seconds == pytest.approx(1.0 + 1.5, abs=0.3)
        assert {path.name for path in tmp_path.iterdir()} == {"record.json", "drive.gif"}

    @pytest.mark.slow
    def test_several_side_by_side(self, tmp_path: Path):
        one = oed.animate(towing(), tmp_path / "one.gif", **HASTY)
        two = oed.animate(towing(), tmp_path / "two.gif", results=["arc", "ipopt", "arc"], **HASTY)
        assert two.results == ("arc", "ipopt")
        with Image.open(one.file) as first, Image.open(two.file) as second:
            assert second.width > first.width

    def test_progress_and_frames_agree(self, tmp_path: Path):
        class Heard:
            total = done = 0

            def begin(self, description: str, total: int) -> None:
                self.total = total

            def advance(self, note: str = "") -> None:
                self.done += 1

        heard = Heard()
        made = oed.animate(omni(), tmp_path / "film.gif", progress=heard, **HASTY)
        assert heard.done == heard.total == made.frames

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"results": ["nonsense"]}, r"no drive of the name 'nonsense'; the record has ipopt, arc"),
            ({"results": list("abcde")}, "at most 4, got 5"),
            ({"speed": 0.0}, "speed: expected more than 0"),
            ({"fps": 80.0}, "at most 50"),
            ({"fps": 1e-300}, r"at least 0\.01 frames"),
            ({"speed": 1e-4}, "speed: a film of .* frames, expected at most 2000; take a higher speed"),
            ({"speed": 5e-324}, "has inf frames, expected at most 2000"),
        ],
    )
    def test_mistakes(self, tmp_path: Path, options, message: str):
        with pytest.raises(UserMistake, match=message):
            oed.animate(towing(), tmp_path / "film.gif", **options)
        assert list(tmp_path.iterdir()) == []

    def test_a_record_from_no_folder_needs_a_name(self):
        with pytest.raises(UserMistake, match="expected a name to write to"):
            oed.animate(towing())

    @pytest.mark.parametrize("kind", ["without_drive", "only_infeasible_drive", "empty"])
    def test_nothing_to_show(self, kind: str, tmp_path: Path):
        with pytest.raises(RecordError, match="no feasible result; the record has"):
            oed.animate(sample_records.RECORDS[kind](), tmp_path / "film.gif")

    def test_an_infeasible_drive_can_be_asked_for(self, tmp_path: Path):
        record = sample_records.only_infeasible_drive()
        name = record.results[0].name
        assert oed.animate(record, tmp_path / "film.gif", results=[name], **HASTY).results == (name,)

    def test_a_long_film_has_fewer_frames_a_second(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("oed.report.film.writing.FRAMES", 10)
        assert oed.animate(omni(), tmp_path / "film.gif", speed=8.0).fps == 10.0
        assert oed.animate(omni(), tmp_path / "film.gif", speed=16.0).fps == 20.0

    def test_a_gif_has_no_more_frames_than_memory_holds(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ):
        monkeypatch.setitem(FORMATS, ".gif", replace(FORMATS[".gif"], most=12))
        made = oed.animate(omni(), tmp_path / "film.gif", speed=2.0)
        assert 1.0 < made.fps < 10.0
        with pytest.raises(UserMistake, match=r"expected at most 12; .* or make an MP4"):
            oed.animate(omni(), tmp_path / "film.gif", speed=2.0, fps=20.0)

    @pytest.mark.slow
    def test_the_demos_film_is_small(self, tmp_path: Path):
        # From a frame to the next, ten times as much moves: the whole film is smaller than ten of this.
        made = oed.animate(REPORTS / "choi_skid_steer", tmp_path / "film.gif", fps=2.0)
        assert made.speed == 1.0
        # 20 s, its last frame for as long as every other, and a rest.
        assert made.seconds == pytest.approx(20.0 + 1 / made.fps + 1.5)
        assert film_rate(made.seconds, made.file, None) == 20.0
        assert 10 * made.file.stat().st_size < 1.5e6


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of two drives, side by side."""
    file = tmp_path_factory.mktemp("film") / "drive.gif"
    return oed.animate(towing(), file, results=["arc", "ipopt"], **HASTY).file


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
class TestReport:
    """A report shows the film that lies beside it, if it is of its drives."""

    @staticmethod
    def pages(record: Record, folder: Path) -> tuple[str, str]:
        html = write_report(record, folder).read_text(encoding="utf-8")
        return html, (folder / "report.md").read_text(encoding="utf-8")

    def test_without_one_it_says_how_to_make_it(self, tmp_path: Path):
        html, markdown = self.pages(towing(), tmp_path)
        assert "`oed animate .`" in markdown
        assert "data:image/gif" not in html
        assert "](drive.gif)" not in markdown

    def test_with_one(self, film: Path, tmp_path: Path):
        copy(film, tmp_path)
        html, markdown = self.pages(towing(), tmp_path)
        assert "![Film of arc and ipopt in the room](drive.gif)" in markdown
        assert "data:image/gif;base64,R0lGOD" in html
        assert len(html) > film.stat().st_size
        assert "`oed animate .`" not in markdown

    def test_a_design_is_called_one_whatever_found_it(self, film: Path, tmp_path: Path):
        data = towing().data
        for one in data["results"]:
            one["kind"] = "ipopt"
        record = record_from({**data, "best": "ipopt"})
        copy(film, tmp_path)
        assert "![Film of Design 2 and Designed drive in the room]" in self.pages(record, tmp_path)[1]
        assert Cast.of(record.best, called(record, record.best)).title.startswith("Designed drive")

    def test_one_of_other_drives_is_not_shown(self, film: Path, tmp_path: Path):
        copy(film, tmp_path)
        changed = towing().data
        changed["results"][0]["drive"]["poses"][5][0] += 0.1
        html, markdown = self.pages(record_from(changed), tmp_path)
        assert "`drive.gif` shows other drives than this record's; `oed animate` makes it again." in markdown
        assert "data:image/gif" not in html
        # Of one that the record no longer has, too.
        gone = {**towing().data, "results": towing().data["results"][1:], "best": "arc"}
        assert "data:image/gif" not in self.pages(record_from(gone), tmp_path)[0]

    @pytest.mark.parametrize("comment", ["", "oed on holiday", 'oed {"results": []}', "oed 7"])
    def test_a_film_from_elsewhere(self, comment: str, tmp_path: Path):
        Image.new("RGB", (9, 9)).save(tmp_path / "drive.gif", comment=comment.encode())
        html, markdown = self.pages(towing(), tmp_path)
        assert "![A film of the drive](drive.gif)" in markdown
        assert "data:image/gif" in html

    def test_what_is_no_gif_is_none(self, tmp_path: Path):
        (tmp_path / "drive.gif").write_text("nothing of the kind")
        assert "](drive.gif)" not in self.pages(towing(), tmp_path)[1]
