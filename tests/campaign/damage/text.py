"""Damage to any text: bytes, lines, cells, quotes, numbers, encodings."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

Rng = np.random.Generator
Damage = Callable[[Rng, bytes], bytes]

NUMBER = re.compile(rb"(?<![\w.])-?\d+\.?\d*(?:[eE][+-]?\d+)?")
ODD_NUMBERS = (
    b"nan",
    b"inf",
    b"-inf",
    b".nan",
    b".inf",
    b"1e300",
    b"-1e300",
    b"1e-300",
    b"1e999",
    b"0",
    b"-1",
    b"-0.0",
    b"",
    b"true",
    b"0x10",
    b"1_000",
    b"1,5",
    b"1e29",
    b"9" * 5000,
    b"5 m**(9**9**9)",
    "٣".encode(),
)


def flip_bytes(rng: Rng, data: bytes) -> bytes:
    """Some bits turned over."""
    found = bytearray(data)
    for place in rng.integers(len(found), size=int(rng.integers(1, 5))):
        found[place] ^= 1 << int(rng.integers(8))
    return bytes(found)


def replace_bytes(rng: Rng, data: bytes) -> bytes:
    """Some bytes replaced by any others."""
    found = bytearray(data)
    for place in rng.integers(len(found), size=int(rng.integers(1, 5))):
        found[place] = int(rng.integers(256))
    return bytes(found)


def truncate(rng: Rng, data: bytes) -> bytes:
    """Cut short, anywhere or at a line's end."""
    place = int(rng.integers(len(data)))
    if rng.random() < 0.5:
        place = data.rfind(b"\n", 0, place) + 1
    return data[:place]


def _changed_lines(rng: Rng, data: bytes, change: Callable[[list[bytes], int], None]) -> bytes:
    lines = data.splitlines(keepends=True)
    change(lines, int(rng.integers(len(lines))))
    return b"".join(lines)


def delete_line(rng: Rng, data: bytes) -> bytes:
    """One or some lines missing."""
    count = int(rng.integers(1, 4))

    def change(lines: list[bytes], place: int) -> None:
        del lines[place : place + count]

    return _changed_lines(rng, data, change)


def double_line(rng: Rng, data: bytes) -> bytes:
    """A line twice."""
    return _changed_lines(rng, data, lambda lines, place: lines.insert(place, lines[place]))


def swap_lines(rng: Rng, data: bytes) -> bytes:
    """Two neighbouring lines exchanged."""

    def change(lines: list[bytes], place: int) -> None:
        other = (place + 1) % len(lines)
        lines[place], lines[other] = lines[other], lines[place]

    return _changed_lines(rng, data, change)


def stray_quote(rng: Rng, data: bytes) -> bytes:
    """A quotation mark, or another sign that means something, where none belongs."""
    place = int(rng.integers(len(data)))
    sign = (b'"', b"'", b"[", b"{", b"}", b":", b"#", b"&", b"*", b"|", b",", b"\t", b"\x00", b"\x1b[31m")
    return data[:place] + sign[int(rng.integers(len(sign)))] + data[place:]


def odd_number(rng: Rng, data: bytes) -> bytes:
    """A number replaced by something odd."""
    found = list(NUMBER.finditer(data))
    if not found:
        return truncate(rng, data)
    one = found[int(rng.integers(len(found)))]
    odd = ODD_NUMBERS[int(rng.integers(len(ODD_NUMBERS)))]
    return data[: one.start()] + odd + data[one.end() :]


def other_encoding(rng: Rng, data: bytes) -> bytes:
    """In another encoding, with a mark of it, other line ends, or nothing at all."""
    text = data.decode("utf-8")
    choices = (
        text.encode("utf-16"),
        text.encode("utf-32"),
        b"\xef\xbb\xbf" + data,
        data.replace(b"\n", b"\r\n"),
        data.replace(b"\n", b"\r"),
        data + b"\xff\xfe",
        ("ä" + text).encode("latin-1", "replace"),
        b"",
        b"\n",
        b"\x00" * 100,
        data[: len(data) // 2] + bytes(range(256)) + data[len(data) // 2 :],
    )
    return choices[int(rng.integers(len(choices)))]


ANY: tuple[Damage, ...] = (
    flip_bytes,
    replace_bytes,
    truncate,
    delete_line,
    double_line,
    swap_lines,
    stray_quote,
    odd_number,
    odd_number,
    other_encoding,
)
