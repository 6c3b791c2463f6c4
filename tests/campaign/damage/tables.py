"""Damage to tables: columns, cells, headers, and far too many rows."""

from __future__ import annotations

import numpy as np

from .text import Damage

Rng = np.random.Generator

MANY = 2_000_000
"""Rows of a log that is far too long."""
LONG_SHARE = 0.003


def _cells(data: bytes) -> list[list[str]]:
    return [line.split(",") for line in data.decode("utf-8").splitlines()]


def _joined(rows: list[list[str]]) -> bytes:
    return ("\n".join(",".join(row) for row in rows) + "\n").encode()


def swap_columns(rng: Rng, data: bytes) -> bytes:
    """Two columns exchanged, with their names, or with the names left where they were."""
    rows = _cells(data)
    one, other = rng.choice(len(rows[0]), 2, replace=False)
    for row in rows[int(rng.integers(2)) :]:
        row[one], row[other] = row[other], row[one]
    return _joined(rows)


def same_name_twice(rng: Rng, data: bytes) -> bytes:
    """A header in which two columns have one name."""
    rows = _cells(data)
    one, other = rng.choice(len(rows[0]), 2, replace=False)
    rows[0][one] = rows[0][other]
    return _joined(rows)


def drop_column(rng: Rng, data: bytes) -> bytes:
    """A column missing."""
    rows, place = _cells(data), int(rng.integers(len(_cells(data)[0])))
    return _joined([row[:place] + row[place + 1 :] for row in rows])


def odd_cell(rng: Rng, data: bytes) -> bytes:
    """A cell missing, doubled or empty."""
    rows = _cells(data)
    row = rows[int(rng.integers(1, len(rows)))]
    place = int(rng.integers(len(row)))
    row[place : place + 1] = ([], [row[place]] * 2, [""])[int(rng.integers(3))]
    return _joined(rows)


def still(rng: Rng, data: bytes) -> bytes:
    """A column that never changes."""
    rows, place = _cells(data), int(rng.integers(len(_cells(data)[0])))
    for row in rows[2:]:
        row[place] = rows[1][place]
    return _joined(rows)


def backwards(rng: Rng, data: bytes) -> bytes:
    """All rows the other way round."""
    rows = _cells(data)
    return _joined([rows[0], *rows[:0:-1]])


def far_too_long(rng: Rng, data: bytes) -> bytes:
    """The rows over and over, each time with later times: a log of two million."""
    rows = [line.split(",") for line in data.decode("utf-8").splitlines()]
    body, times = rows[1:], (0, 3) if rows[0][0] == "encoder_ms" else (0,)
    spans = {
        place: float(body[-1][place]) * 2 - float(body[-2][place]) - float(body[0][place]) for place in times
    }
    parts = [",".join(rows[0])]
    for turn in range(MANY // len(body)):
        for row in body:
            later = list(row)
            for place in times:
                later[place] = f"{float(row[place]) + turn * spans[place]:.3f}"
            parts.append(",".join(later))
    return ("\n".join(parts) + "\n").encode()


TABLES: tuple[Damage, ...] = (swap_columns, same_name_twice, drop_column, odd_cell, still, backwards)
