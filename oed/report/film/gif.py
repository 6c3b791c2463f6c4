"""GIF, by Pillow: one palette for the whole film, and a time for every frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from oed.report.film.frame import Frame

if TYPE_CHECKING:
    from PIL.Image import Image

FASTEST = 50
"""Frames a second; viewers slow down delays below 1/50 s."""
COLOURS = 255
"""Of the palette: one more lets the frame before show through."""
TICK = 100
"""A GIF's units of time per second."""


def write_gif(frames: Iterable[Frame], file: Path, fps: float, colours: Frame | None, comment: str) -> int:
    """Write frames as a GIF that repeats for ever; returns their number. See `write_frames`.

    Frames that are alike become one that is shown for longer. Delays are rounded so that the film as a whole
    keeps its time.
    """
    film = _Film(frames, fps, colours)
    first = next(film)
    # Pillow leaves out what stays the same from frame to frame, and finds the frames that are alike.
    with file.open("wb") as out:
        first.save(out, "GIF", save_all=True, append_images=film, loop=0, comment=comment, disposal=1)
    return film.count


class _Film(Iterator["Image"]):
    """The frames in the film's colours, each with the time that it is shown, and how many there were."""

    def __init__(self, frames: Iterable[Frame], fps: float, colours: Frame | None) -> None:
        from PIL import Image

        self._frames, self._fps, self.count = iter(frames), fps, 0
        first = next(self._frames)
        self._frames = chain([first], self._frames)
        every = Image.fromarray(first if colours is None else colours)
        self._palette = every.quantize(COLOURS, dither=Image.Dither.NONE)

    def __next__(self) -> Image:
        from PIL import Image

        frame = Image.fromarray(next(self._frames))
        image = frame.quantize(palette=self._palette, dither=Image.Dither.NONE)
        begin, end = (round(count / self._fps * TICK) for count in (self.count, self.count + 1))
        image.info["duration"] = (end - begin) * 1000 // TICK
        self.count += 1
        return image
