"""How far apart positions can lie: enumeration, climbing walks, and every n-th reading."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from oed.bounds.spread import SUM_STEPS, largest_spread

Array = npt.NDArray[np.float64]


def reading_every(samples: int, every: int) -> npt.NDArray[np.bool_]:
    read = np.zeros(samples + 1, dtype=bool)
    read[::every] = True
    return read


def spread_of(walks: Array, read: npt.NDArray[np.bool_]) -> Array:
    """Sum of (x - mean)^2 over the samples read, of walks (..., N + 1)."""
    taken = walks[..., read]
    return ((taken - taken.mean(axis=-1, keepdims=True)) ** 2).sum(axis=-1)


def enumerated(
    low: float, high: float, start: float | None, step: float, read: npt.NDArray[np.bool_]
) -> float:
    """The best of all walks over a bound, or the start, plus or minus multiples of the step."""
    seeds = [low, high] + ([] if start is None else [start])
    values = np.array([seed + step * move for seed in seeds for move in range(-60, 61)])
    values = np.unique(np.round(values[(values >= low - 1e-9) & (values <= high + 1e-9)], 9))
    walks = values[:, None] if start is None else np.array([[start]])
    for _ in range(len(read) - 1):
        steps = values[None, :] - walks[:, -1:]
        rows, columns = np.nonzero(np.abs(steps) <= step + 1e-8)
        walks = np.hstack([walks[rows], values[columns][:, None]])
    return float(spread_of(walks, read).max())


def rounding(low: float, high: float, read: Array) -> float:
    """At most so much is added for the sum's grid: 2 |sum| rounding / readings."""
    count = int(read.sum())
    return (high - low) ** 2 * count**2 / SUM_STEPS


CASES = [
    (-1.0, 1.0, 0.0, 0.5, 1),
    (-1.0, 1.0, None, 0.5, 1),
    (-1.0, 1.0, 0.3, 0.35, 1),
    (-1.0, 2.0, -1.0, 0.7, 2),
    (0.0, 1.0, 0.9, 5.0, 1),
    (0.0, 1.0, None, 5.0, 3),
    (-0.4, 0.4, 0.2, 0.1, 2),
    (5.0, 6.0, 5.5, 0.21, 1),
]


@pytest.mark.parametrize(("low", "high", "start", "step", "every"), CASES)
def test_it_is_what_enumeration_finds(
    low: float, high: float, start: float | None, step: float, every: int
) -> None:
    read = reading_every(4, every)
    found = largest_spread(low, high, start, np.full(4, step), read)
    best = enumerated(low, high, start, step, read)
    assert best <= found * (1 + 1e-9)
    assert found <= best + rounding(low, high, read) + 1e-6


@pytest.mark.parametrize("seed", range(8))
def test_no_walk_is_spread_further(seed: int) -> None:
    rng = np.random.default_rng(seed)
    samples = int(rng.integers(5, 60))
    low, high = -rng.uniform(0.1, 3), rng.uniform(0.1, 3)
    start = None if seed % 2 else float(rng.uniform(low, high))
    steps = rng.uniform(0.02, 0.4) * rng.uniform(0.3, 1.0, samples)
    read = reading_every(samples, int(rng.integers(1, 5)))
    found = largest_spread(low, high, start, steps, read)

    def walks(pulls: Array, begin: Array) -> Array:
        points = [begin]
        for index, step in enumerate(steps):
            points.append(np.clip(points[-1] + step * np.clip(pulls[:, index], -1, 1), low, high))
        return np.stack(points, axis=1)

    count = 400
    begin = rng.uniform(low, high, count) if start is None else np.full(count, start)
    pulls = np.sign(rng.normal(size=(count, samples)).cumsum(axis=1) + rng.normal(0, 3, (count, 1)))
    for _ in range(25):
        drawn = walks(pulls, begin)
        assert drawn.min() >= low
        assert drawn.max() <= high
        values = spread_of(drawn, read)
        assert values.max() <= found
        best = int(np.argmax(values))
        flips = rng.random((count, samples)) < 0.1
        pulls = np.where(flips, rng.choice([-1.0, 0.0, 1.0], (count, samples)), pulls[best])
        begin = np.full(count, begin[best])
        if start is None:
            begin[::3] = rng.choice([low, high], len(begin[::3]))


def test_with_steps_enough_half_the_readings_are_at_either_end() -> None:
    read = reading_every(9, 1)
    assert largest_spread(-1.0, 1.0, None, np.full(9, 2.0), read) == pytest.approx(10.0, rel=1e-2)


def test_a_free_start_and_more_room_and_more_speed_are_never_less() -> None:
    read, steps = reading_every(20, 1), np.full(20, 0.1)
    fixed = largest_spread(-1.0, 1.0, 0.0, steps, read)
    assert fixed <= largest_spread(-1.0, 1.0, None, steps, read)
    assert fixed <= largest_spread(-1.5, 1.0, 0.0, steps, read) + rounding(-1.5, 1.0, read)
    assert fixed <= largest_spread(-1.0, 1.0, 0.0, 1.5 * steps, read) + rounding(-1.0, 1.0, read)


def test_one_reading_alone_has_no_spread() -> None:
    read = reading_every(8, 100)
    assert largest_spread(-1.0, 1.0, 0.0, np.full(8, 0.2), read) == pytest.approx(0.0, abs=1e-3)


def test_the_largest_of_unequal_steps_counts() -> None:
    read = reading_every(8, 2)
    steps = np.array([0.1, 0.2, 0.3, 0.1, 0.1, 0.3, 0.2, 0.1])
    expected = largest_spread(-1.0, 1.0, 0.0, np.full(8, 0.3), read)
    assert largest_spread(-1.0, 1.0, 0.0, steps, read) == expected


@pytest.mark.slow
def test_very_many_readings_are_bounded_still() -> None:
    read = reading_every(5000, 1)
    found = largest_spread(-1.0, 1.0, None, np.full(5000, 0.5), read)
    walk = np.where(np.arange(5001) < 2500, -1.0, 1.0)
    assert found >= spread_of(walk, read) - 5
