"""Films: frames in, a GIF or an MP4 out. A new format is an entry in `WRITERS`."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from oed.foundation.errors import UserMistake
from oed.foundation.files import require_replaceable, unwritten
from oed.report.film.frame import Frame
from oed.report.film.gif import FASTEST, write_gif
from oed.report.film.mp4 import require_ffmpeg, write_mp4

Writer = Callable[[Iterable[Frame], Path, float, Frame | None, str], int]
WRITERS: dict[str, Writer] = {".gif": write_gif, ".mp4": write_mp4}
"""Ending of a file -> what writes it."""
MOST_FRAMES = {".gif": 2_000, ".mp4": 100_000}
"""Of a film: of a GIF, which is held in memory, some hundred seconds; else more than an hour."""
FPS = 20.0
"""Frames a second, where not said otherwise."""
FRAMES, LEAST_FPS = 500, 10.0
"""Frames beyond which a film has fewer a second, where not said otherwise, and how few as long as can be."""
SLOWEST = 0.01
"""Frames a second: a GIF cannot show one for much longer."""


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
    require_format(target, fps)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        place = tempfile.TemporaryDirectory(dir=target.parent, prefix=".oed-")
    except OSError as error:
        raise unwritten(f"{target.parent}: cannot write there", error) from None
    with place as folder:
        part = Path(folder) / target.name
        try:
            count = WRITERS[target.suffix.lower()](frames, part, fps, colours, comment)
            os.replace(part, target)
        except OSError as error:
            raise unwritten(f"{target}: cannot be written", error) from None
    return count


def usual_rate(seconds: float, file: Path, fastest: float = FPS) -> float:
    """Frames a second of a film that lasts so long [s], where not said otherwise."""
    most = MOST_FRAMES[file.suffix.lower()]
    return min(fastest, max(FRAMES / seconds, LEAST_FPS), max(most / seconds, 1.0))


def require_length(seconds: float, fps: float, file: Path) -> None:
    """Refuse a film [s] of too many frames, before any is made.

    Raises:
        UserMistake: more than `MOST_FRAMES`.
    """
    most, frames = MOST_FRAMES[file.suffix.lower()], seconds * fps
    if frames > most + 0.5:
        longer = ", or make an MP4" if frames <= MOST_FRAMES[".mp4"] else ""
        raise UserMistake(
            f"speed: a film of {seconds:.3g} s has {frames:.3g} frames, expected at most {most}; take a "
            f"higher speed, or fewer frames a second (fps){longer}"
        )


def require_format(file: Path, fps: float) -> None:
    """Refuse what cannot be written, before frames are made.

    Raises:
        UserMistake: another kind of file, a rate that the kind does not have, no ffmpeg for an MP4, a link, a
            pipe or a device in its place.
    """
    ending = file.suffix.lower()
    if ending not in WRITERS:
        raise UserMistake(f"{file}: expected a name that ends in {' or '.join(WRITERS)}")
    if not 0 < fps < float("inf"):
        raise UserMistake(f"fps: expected more than 0 frames a second, got {fps:g}")
    if fps < SLOWEST:
        raise UserMistake(f"fps: expected at least {SLOWEST} frames a second, got {fps:g}")
    if ending == ".gif" and fps > FASTEST:
        raise UserMistake(f"fps: a GIF shows at most {FASTEST} frames a second, got {fps:g}")
    if ending == ".mp4":
        require_ffmpeg()
    require_replaceable(file)
