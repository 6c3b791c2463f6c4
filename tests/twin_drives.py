"""Twins of real robots: fine simulations of what they truly do, and what encoders and trackers show of it.

Nothing here is the package's: twists are written out, and integrated by exact arcs in steps of `STEP`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from oed.records.record import EstimateRecord

STEP = 0.005
"""Of the simulations [s]."""


def arcs(start: Sequence[float], twists: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Poses (N + 1, 3) after body twists (N, 3) held for `steps` (N,) [s] each."""
    turns = twists[:, 2] * steps
    headings = start[2] + np.concatenate([[0.0], np.cumsum(turns)])
    # Along an arc of angle a the mean direction is (e^(ja) - 1) / (ja).
    small = np.abs(turns) < 1e-6
    safe = np.where(small, 1.0, turns)
    mean = np.where(small, 1 + 0.5j * turns, (np.exp(1j * safe) - 1) / (1j * safe))
    moves = (twists[:, 0] + 1j * twists[:, 1]) * steps * mean * np.exp(1j * headings[:-1])
    places = start[0] + 1j * start[1] + np.concatenate([[0.0], np.cumsum(moves)])
    return np.column_stack([places.real, places.imag, headings])


@dataclass(frozen=True)
class Twin:
    """What a robot truly did.

    Attributes:
        times: (N + 1,) [s], in steps of `STEP`.
        inputs: at those times, (N + 1, inputs).
        turned: their integrals from the first time on, (N + 1, inputs).
        poses: x, y [m], heading [rad], (N + 1, 3).
    """

    times: np.ndarray
    inputs: np.ndarray
    turned: np.ndarray
    poses: np.ndarray

    def rows(self, rate: float, start: float = 0.0) -> np.ndarray:
        """The steps of a clock of some rate [Hz], from a time on."""
        return np.arange(round(start / STEP), len(self.times), round(1 / rate / STEP))


def waves(times: np.ndarray, seed: int, size: float, mean: float = 0.0, fastest: float = 0.8) -> np.ndarray:
    """A smooth signal (n,) of four waves of up to `fastest` [rad/s], of an amplitude of some `size`."""
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0.15, fastest, 4)[:, None] * times + rng.uniform(0, 2 * np.pi, 4)[:, None]
    return mean + size * np.sin(phases).sum(axis=0) / np.sqrt(2)


def driven(
    inputs: Callable[[np.ndarray], np.ndarray],
    twists: Callable[[np.ndarray], np.ndarray],
    seconds: float,
    start: Sequence[float] = (0.3, -0.2, 0.7),
) -> Twin:
    """A drive.

    Args:
        inputs: of times (n,), (n, inputs).
        twists: of inputs (n, inputs) in the middles of the steps, (n, 3).
        seconds: how long.
        start: the first pose.
    """
    times = STEP * np.arange(round(seconds / STEP) + 1)
    middles = inputs(times[:-1] + STEP / 2)
    turned = np.vstack([0 * middles[:1], np.cumsum(STEP * middles, axis=0)])
    return Twin(times, inputs(times), turned, arcs(start, twists(middles), np.full(len(middles), STEP)))


def tracked(
    twin: Twin, rows: np.ndarray, seed: int, noise: tuple[float, float], place: Sequence[float] = (0, 0, 0)
) -> np.ndarray:
    """What a tracker shows, (rows, 3): of a marker at `place`, with noise [m, rad]; headings wrap."""
    rng = np.random.default_rng([seed, 7])
    x, y, heading = twin.poses[rows].T
    turned = heading + place[2] + noise[1] * rng.normal(size=len(rows))
    seen = (x + 1j * y) + (place[0] + 1j * place[1]) * np.exp(1j * heading)
    errors = noise[0] * rng.normal(size=(len(rows), 2))
    places = np.column_stack([seen.real, seen.imag]) + errors
    return np.column_stack([places, np.angle(np.exp(1j * turned))])


def write_csv(file: Path, columns: Mapping[str, np.ndarray]) -> Path:
    """A CSV of these columns."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(file, table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    return file


def pulls(record: EstimateRecord, truth: Mapping[str, float]) -> dict[str, float]:
    """Errors of an estimate in standard errors."""
    return {name: (record.values[name] - value) / record.errors[name] for name, value in truth.items()}
