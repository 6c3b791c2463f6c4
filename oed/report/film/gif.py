"""GIF: one palette for the whole film, and of each frame only the pixels that change."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oed.report.film.frame import Frame

if TYPE_CHECKING:
    from PIL.Image import Image

FASTEST = 50
"""Frames a second; viewers slow down delays below 1/50 s."""
COLOURS, COMMONEST = 255, 64
"""Of the palette, and how many of them are the commonest of the film."""
UNCHANGED = 255
"""Index of the colour that lets the frame before show through."""
TICK = 100
"""A GIF's units of time per second."""
Mask = npt.NDArray[np.bool_]
Patch = tuple["Image", tuple[int, int]]
"""Part of a frame, and the column and row of its corner."""


def write_gif(frames: Iterable[Frame], file: Path, fps: float, colours: Frame | None, comment: str) -> int:
    """Write frames as a GIF that repeats for ever; returns their number. See `write_frames`.

    Frames that are alike become one that is shown for longer. Delays are rounded so that the film as a whole
    keeps its time.
    """
    count, since, pending = 0, 0, None
    with file.open("wb") as out:
        for count, patch in enumerate(_patches(frames, colours), 1):
            if pending is None:
                assert patch is not None
                out.write(_head(patch[0], comment))
            now = round((count - 1) / fps * TICK)
            if patch is not None:
                if pending is not None:
                    out.writelines(_blocks(*pending, now - since))
                pending, since = patch, now
        if pending is not None:
            out.writelines(_blocks(*pending, round(count / fps * TICK) - since))
        out.write(b";")
    return count


def _blocks(image: Image, corner: tuple[int, int], ticks: int) -> list[bytes]:
    from PIL.GifImagePlugin import getdata

    # Pillow takes milliseconds; disposal 1 leaves a frame standing under the next.
    return getdata(image, corner, duration=ticks * 1000 // TICK, transparency=UNCHANGED, disposal=1)


def _patches(frames: Iterable[Frame], colours: Frame | None) -> Iterator[Patch | None]:
    # Of every frame the part that differs from the frame before; None where nothing does.
    from PIL import Image

    before: Frame | None = None
    for frame in frames:
        if before is None:
            palette = _palette(frame if colours is None else colours)
            nearest = _nearest(palette)
            changed = np.ones(frame.shape[:2], dtype=np.bool_)
        else:
            changed = _differ(frame, before)
        before = frame
        if not changed.any():
            yield None
            continue
        rows, columns = _span(changed, 1), _span(changed, 0)
        indices = nearest[_cells(frame[rows, columns])]
        indices[~changed[rows, columns]] = UNCHANGED
        patch = Image.fromarray(indices)
        patch.putpalette(palette.ravel().tolist())
        yield patch, (columns.start, rows.start)


def _palette(frame: Frame) -> Frame:
    # The commonest colours as they are, so that areas keep theirs, and a choice among all; (n, 3).
    from PIL import Image

    pixels = frame.reshape(-1, 3)
    packed = pixels.astype(np.int32) @ np.array([1 << 16, 1 << 8, 1], dtype=np.int32)
    _, places, counts = np.unique(packed, return_index=True, return_counts=True)
    ordered = pixels[places[np.argsort(-counts, kind="stable")]]
    _, first = np.unique(_cells(ordered), return_index=True)
    common = ordered[np.sort(first)[:COMMONEST]]
    chosen = Image.fromarray(frame).quantize(COLOURS - len(common), dither=Image.Dither.NONE)
    others = np.array(chosen.getpalette(), dtype=np.uint8).reshape(-1, 3)
    return np.vstack([common, others])[:COLOURS]


def _cells(colours: Frame) -> npt.NDArray[np.int32]:
    # Number of the cube of colours, 8 wide, that each lies in.
    red, green, blue = np.moveaxis(colours.astype(np.int32) >> 3, -1, 0)
    return np.asarray(red << 10 | green << 5 | blue)


def _nearest(palette: Frame) -> npt.NDArray[np.uint8]:
    # Index of the palette's nearest colour for every cube; its own for a cube with one of the commonest.
    middles = 8 * np.stack(np.meshgrid(*[np.arange(32)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 4
    gaps = (middles**2).sum(axis=1)[:, None] - 2 * middles @ palette.T.astype(int)
    gaps += (palette.astype(int) ** 2).sum(axis=1)
    nearest: npt.NDArray[np.uint8] = np.argmin(gaps, axis=1).astype(np.uint8)
    nearest[_cells(palette[COMMONEST - 1 :: -1])] = np.arange(len(palette))[COMMONEST - 1 :: -1]
    return nearest


def _differ(frame: Frame, before: Frame) -> Mask:
    # Many times as fast as any(axis=2), which goes pixel by pixel.
    red, green, blue = (frame[..., channel] != before[..., channel] for channel in range(3))
    return np.asarray(red | green | blue)


def _span(changed: Mask, axis: int) -> slice:
    places = np.flatnonzero(changed.any(axis=axis))
    return slice(int(places[0]), int(places[-1]) + 1)


def _head(first: Image, comment: str) -> bytes:
    # Size, a table of 256 colours, "repeat for ever", and the comment in blocks of at most 255 bytes.
    table = bytes(first.getpalette() or []).ljust(3 * 256, b"\0")
    text = comment.encode()
    blocks = [text[start : start + 255] for start in range(0, len(text), 255)]
    note = b"".join(bytes([len(block)]) + block for block in blocks)
    return b"".join(
        [
            b"GIF89a",
            struct.pack("<HHBBB", *first.size, 0xF7, 0, 0),
            table,
            b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00",
            b"\x21\xfe" + note + b"\0" if note else b"",
        ]
    )
