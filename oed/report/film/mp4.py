"""MP4, by the program ffmpeg."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from itertools import chain
from pathlib import Path

from oed.foundation.errors import Failure, UserMistake
from oed.report.film.frame import Frame

EVEN = "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white"
"""What players can show has an even width and height."""


def write_mp4(frames: Iterable[Frame], file: Path, fps: float, colours: Frame | None, comment: str) -> int:
    """Write frames as an MP4 that plays everywhere; returns their number. See `write_frames`."""
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
