"""Frames in, a GIF or an MP4 out. A new format is a `Format` in `FORMATS`."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
import numpy.typing as npt

from oed.foundation.errors import Failure, UserMistake
from oed.foundation.files import require_replaceable, unwritten
from oed.foundation.work.progress import Progress, Silent

Frame = npt.NDArray[np.uint8]
"""An RGB image, (height, width, 3)."""
FPS = 20.0
"""Frames a second, where not said otherwise."""
FRAMES, LEAST_FPS = 500, 10.0
"""Frames beyond which a film has fewer a second, where not said otherwise, and how few as long as can be."""
SLOWEST = 0.01
"""Frames a second: a GIF cannot show one for much longer."""
COLOURS = 255
"""Of a GIF's palette: one more lets the frame before show through."""
TICK = 100
"""A GIF's units of time per second."""
EVEN = "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white"
"""What players of an MP4 can show has an even width and height."""


@dataclass(frozen=True)
class Format:
    """A kind of film.

    Attributes:
        write: takes what `write_frames` does, in its order; returns the number of frames.
        most: frames of a film.
        fastest: frames a second.
        needs: looks for what it needs; refuses a film where that is not there.
    """

    write: Callable[[Iterable[Frame], Path, float, Frame | None, str], int]
    most: int
    fastest: float = math.inf
    needs: Callable[[], object] = lambda: None


def write_frames(
    frames: Iterable[Frame],
    file: str | Path,
    fps: float,
    *,
    colours: Frame | None = None,
    comment: str = "",
) -> int:
    """Write frames as a film, under a temporary name first: an interrupted one leaves nothing behind.

    Args:
        frames: at least one, taken one at a time; RGB images of one size, (height, width, 3) of uint8.
        file: ends in .gif or .mp4.
        fps: frames a second, of a GIF at most 50.
        colours: an image with all colours of the film, from which a GIF's 255 are chosen; by default the
            first frame.
        comment: kept in the file.

    Returns:
        The number of frames.

    Raises:
        UserMistake: another kind of file, a rate that the kind does not have, no ffmpeg for an MP4, a place
            that cannot be written to.
        Failure: ffmpeg could not write it, or there is no room left.
    """
    target = Path(file)
    form = require_format(target, fps)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        place = tempfile.TemporaryDirectory(dir=target.parent, prefix=".oed-")
    except OSError as error:
        raise unwritten(f"{target.parent}: cannot write there", error) from None
    with place as folder:
        part = Path(folder) / target.name
        try:
            count = form.write(frames, part, fps, colours, comment)
            os.replace(part, target)
        except OSError as error:
            raise unwritten(f"{target}: cannot be written", error) from None
    return count


def film_rate(seconds: float, file: Path, fps: float | None, usual: float = FPS) -> float:
    """Frames a second of a film that lasts so long [s]: those asked for, or as suits its length.

    Args:
        seconds: that the film lasts.
        file: it is written to.
        fps: frames a second asked for.
        usual: frames a second otherwise.

    Raises:
        UserMistake: more frames than its format takes, before any is made.
    """
    most = FORMATS[file.suffix.lower()].most
    rate = min(usual, max(FRAMES / seconds, LEAST_FPS), max(most / seconds, 1.0)) if fps is None else fps
    frames = seconds * rate
    if frames > most + 0.5:
        longer = ", or make an MP4" if frames <= FORMATS[".mp4"].most else ""
        raise UserMistake(
            f"speed: a film of {seconds:.3g} s has {frames:.3g} frames, expected at most {most}; take a "
            f"higher speed, or fewer frames a second (fps){longer}"
        )
    return rate


def heard(frames: Iterable[Frame], total: int, file: Path, progress: Progress | None) -> Iterator[Frame]:
    """Frames of a film, of which a listener hears one by one.

    Args:
        frames: of the film.
        total: how many.
        file: it is written to.
        progress: the listener.
    """
    listener = Silent() if progress is None else progress
    listener.begin(f"frames of {file.name}", total)
    for frame in frames:
        yield frame
        listener.advance()


def require_speed(speed: float) -> None:
    """Refuse a film that does not move.

    Raises:
        UserMistake: a speed that is not above 0, or not finite.
    """
    if not 0 < speed < math.inf:
        raise UserMistake(f"speed: expected more than 0, got {speed:g}")


def require_format(file: Path, fps: float) -> Format:
    """The format of a film; what cannot be written is refused before frames are made.

    Raises:
        UserMistake: another kind of file, a rate that the kind does not have, no ffmpeg for an MP4, a link, a
            pipe or a device in its place.
    """
    form = FORMATS.get(file.suffix.lower())
    if form is None:
        raise UserMistake(f"{file}: expected a name that ends in {' or '.join(FORMATS)}")
    if not 0 < fps < math.inf:
        raise UserMistake(f"fps: expected more than 0 frames a second, got {fps:g}")
    if fps < SLOWEST:
        raise UserMistake(f"fps: expected at least {SLOWEST} frames a second, got {fps:g}")
    if fps > form.fastest:
        raise UserMistake(f"fps: a GIF shows at most {form.fastest} frames a second, got {fps:g}")
    form.needs()
    require_replaceable(file)
    return form


def _write_gif(frames: Iterable[Frame], file: Path, fps: float, colours: Frame | None, comment: str) -> int:
    # By Pillow; it repeats for ever. Frames that are alike become one that is shown for longer. Delays are
    # rounded so that the film as a whole keeps its time.
    from PIL import Image

    pictures, count = iter(frames), 0
    first = next(pictures)
    every = Image.fromarray(first if colours is None else colours)
    palette = every.quantize(COLOURS, dither=Image.Dither.NONE)

    def images() -> Iterator[Image.Image]:
        nonlocal count
        for frame in chain([first], pictures):
            image = Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
            begin, end = (round(number / fps * TICK) for number in (count, count + 1))
            image.info["duration"] = (end - begin) * 1000 // TICK
            count += 1
            yield image

    film = images()
    image = next(film)
    # Pillow leaves out what stays the same from frame to frame, and finds the frames that are alike.
    with file.open("wb") as out:
        image.save(out, "GIF", save_all=True, append_images=film, loop=0, comment=comment, disposal=1)
    return count


def _write_mp4(frames: Iterable[Frame], file: Path, fps: float, colours: Frame | None, comment: str) -> int:
    # By ffmpeg; it plays everywhere.
    del colours
    images = iter(frames)
    first = next(images)
    height, width = first.shape[:2]
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:.12g}", "-i", "-"]
    made = ["-vf", EVEN, "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-metadata", f"comment={comment}"]
    command = [require_ffmpeg(), "-y", "-loglevel", "error", *raw, *made, str(file)]
    count = 0
    encoder = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)  # noqa: S603 - no shell
    assert encoder.stdin is not None
    try:
        # Where ffmpeg gives up, it says why at the end.
        with suppress(BrokenPipeError):
            for frame in chain([first], images):
                encoder.stdin.write(frame.tobytes())
                count += 1
        _, said = encoder.communicate()
    except BaseException:
        encoder.kill()
        encoder.communicate()
        raise
    if encoder.returncode or not file.is_file():
        reason = said.decode(errors="replace").strip().splitlines()
        raise Failure(f"ffmpeg could not write {file.name}: {reason[-1] if reason else 'it gave no reason'}")
    return count


def require_ffmpeg() -> str:
    """Where ffmpeg is.

    Raises:
        UserMistake: nowhere.
    """
    found = shutil.which("ffmpeg")
    if found is None:
        raise UserMistake(
            "an MP4 needs the program ffmpeg, which is not on the PATH: install it (`apt install ffmpeg`, "
            "`brew install ffmpeg`, or https://ffmpeg.org/download.html), or make a GIF"
        )
    return found


FORMATS = {
    ".gif": Format(_write_gif, most=2_000, fastest=50),
    ".mp4": Format(_write_mp4, most=100_000, needs=lambda: require_ffmpeg()),
}
"""By the ending of a file. A GIF is held in memory: some hundred seconds, and viewers slow down delays below
1/50 s; an MP4 may last more than an hour.
"""
