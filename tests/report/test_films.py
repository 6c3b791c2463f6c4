"""Films: what is written is what was drawn, at its time, whole or not at all."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from oed.foundation.errors import Failure, UserMistake
from oed.report.film.writing import Frame, write_frames


def squares(count: int, size: tuple[int, int] = (24, 31)) -> list[Frame]:
    """A red square that wanders over a white field."""
    frames = []
    for number in range(count):
        frame = np.full((*size, 3), 255, dtype=np.uint8)
        frame[5:9, number : number + 4] = (200, 30, 10)
        frames.append(frame)
    return frames


def read(file: Path) -> tuple[list[Frame], list[int]]:
    """Frames of a GIF and how long each is shown [ms]."""
    frames, shown = [], []
    with Image.open(file) as image:
        for number in range(image.n_frames):
            image.seek(number)
            frames.append(np.asarray(image.convert("RGB")))
            shown.append(image.info["duration"])
    return frames, shown


def test_a_gif_holds_every_frame(tmp_path: Path):
    frames = squares(12)
    assert write_frames(iter(frames), tmp_path / "film.gif", 20) == 12
    found, shown = read(tmp_path / "film.gif")
    np.testing.assert_array_equal(found, frames)
    assert shown == [50] * 12


def test_a_rate_that_is_no_whole_number_of_ticks_keeps_time(tmp_path: Path):
    write_frames(squares(24), tmp_path / "film.gif", 30)
    assert sum(read(tmp_path / "film.gif")[1]) == 800


def test_frames_alike_are_one_that_is_shown_for_longer(tmp_path: Path):
    first, second, third = squares(3)
    count = write_frames([first, second, second, second, third, third], tmp_path / "film.gif", 10)
    found, shown = read(tmp_path / "film.gif")
    assert (count, len(found), shown) == (6, 3, [100, 300, 200])


def test_it_repeats_and_keeps_its_comment(tmp_path: Path):
    comment = "words " * 100
    write_frames(squares(3), tmp_path / "film.gif", 10, comment=comment)
    with Image.open(tmp_path / "film.gif") as image:
        assert image.info["loop"] == 0
        assert image.info["comment"].decode() == comment


@pytest.mark.slow
def test_many_colours_are_met_closely(tmp_path: Path):
    shades = np.random.default_rng(0).integers(0, 256, (40, 50, 3), dtype=np.uint8)
    smooth = np.linspace(0, 255, 50).astype(np.uint8)[None, :, None] * np.ones((40, 1, 3), dtype=np.uint8)
    for frame, most in ((shades, 45), (smooth, 5)):
        write_frames([frame], tmp_path / "film.gif", 10)
        ((found,), _) = read(tmp_path / "film.gif")
        assert np.abs(found.astype(int) - frame).mean() < most / 2
        assert np.abs(found.astype(int) - frame).max(axis=2).mean() < most


def test_colours_are_chosen_from_the_picture_given(tmp_path: Path):
    first, second = np.zeros((2, 8, 8, 3), dtype=np.uint8)
    second[:] = (10, 130, 240)
    write_frames([first, second], tmp_path / "film.gif", 10, colours=np.vstack([first, second]))
    np.testing.assert_array_equal(read(tmp_path / "film.gif")[0], [first, second])


@pytest.mark.parametrize(
    ("name", "fps", "message"),
    [
        ("film.avi", 20, "ends in .gif or .mp4"),
        ("film", 20, "ends in .gif or .mp4"),
        ("film.gif", 51, "at most 50 frames a second"),
        ("film.gif", 0, "more than 0"),
        ("film.gif", float("nan"), "more than 0"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path: Path, name: str, fps: float, message: str):
    with pytest.raises(UserMistake, match=message):
        write_frames(squares(2), tmp_path / name, fps)
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_to(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserMistake, match="cannot write there"):
        write_frames(squares(2), tmp_path / "file" / "film.gif", 10)
    (tmp_path / "film.gif").mkdir()
    with pytest.raises(UserMistake, match="cannot be written"):
        write_frames(squares(2), tmp_path / "film.gif", 10)


def test_a_full_disk_is_said(tmp_path: Path):
    def frames() -> Iterator[Frame]:
        yield from squares(3)
        raise OSError(28, "No space left on device")

    with pytest.raises(Failure, match=r"film\.gif: cannot be written: No space left on device"):
        write_frames(frames(), tmp_path / "film.gif", 10)
    assert list(tmp_path.iterdir()) == []


def interrupted() -> Iterator[Frame]:
    yield from squares(3)
    raise KeyboardInterrupt


def test_an_interrupted_film_leaves_the_old_one(tmp_path: Path):
    file = tmp_path / "film.gif"
    file.write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt):
        write_frames(interrupted(), file, 10)
    assert file.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [file]


@pytest.fixture
def encoder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an ffmpeg that writes down its options and what it is given."""
    folder = tmp_path / "bin"
    folder.mkdir()
    program = folder / "ffmpeg"
    program.write_text(
        f"#!{sys.executable}\nimport sys\n"
        "with open(sys.argv[-1], 'wb') as out:\n"
        "    out.write(' '.join(sys.argv[1:-1]).encode() + b'\\n' + sys.stdin.buffer.read())\n"
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(folder))
    return program


def test_an_mp4_is_encoded_by_ffmpeg(tmp_path: Path, encoder: Path):
    frames = squares(5)
    assert write_frames(iter(frames), tmp_path / "film.mp4", 30, comment="words") == 5
    options, _, pixels = (tmp_path / "film.mp4").read_bytes().partition(b"\n")
    assert b"-s 31x24 -r 30 " in options
    assert b"comment=words" in options
    assert pixels == b"".join(frame.tobytes() for frame in frames)


def test_what_ffmpeg_says_is_passed_on(tmp_path: Path, encoder: Path):
    encoder.write_text(f"#!{sys.executable}\nimport sys\nsys.exit('first\\nno such codec')\n")
    with pytest.raises(Failure, match=r"could not write film\.mp4: no such codec"):
        write_frames(squares(5, (400, 400)), tmp_path / "film.mp4", 30)
    assert not (tmp_path / "film.mp4").exists()


def test_an_interrupted_mp4_leaves_nothing(tmp_path: Path, encoder: Path):
    with pytest.raises(KeyboardInterrupt):
        write_frames(interrupted(), tmp_path / "film.mp4", 10)
    assert list(tmp_path.iterdir()) == [encoder.parent]


def test_without_ffmpeg_it_is_said_where_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserMistake, match=r"apt install ffmpeg.*or make a GIF"):
        write_frames(squares(2), tmp_path / "film.mp4", 10)
