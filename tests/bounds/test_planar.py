"""How far apart positions along a path can lie: paths that are climbed never exceed the bound."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from builders import problem_of
from places import PROBLEMS

import oed
from oed.bounds import Certificate, bound, planar
from oed.bounds.blocks import blocks
from oed.bounds.effort import Effort
from oed.bounds.joint import PLANAR
from oed.bounds.planar import largest_planar_spread
from oed.bounds.spread import largest_spread
from oed.bounds.starts import Start
from oed.kernel.criteria import E
from oed.robots.limits import Rectangle, WheelAcceleration, WheelSpeed
from oed.robots.sensors import Poses
from oed.robots.sensors.poses import AbsoluteNoise
from oed.robots.space import DesignSpace

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Box = tuple[float, float, float, float]

LEGS, RUNS = 6, 120
SEEDS = (9, 16, 26, 14, 17)
"""Three with a start and two without: 1, 2, 8 and 4 images."""


def spread_of(paths: Array, read: Bools) -> Array:
    taken = paths[:, read]
    return ((taken - taken.mean(axis=1, keepdims=True)) ** 2).sum(axis=(1, 2))


def followed(places: Array, waits: Array, start: Array, steps: Array) -> Array:
    """Paths (runs, N + 1, 2) from place to place (runs, legs, 2) at top speed, waiting at each."""
    here, leg, every = start.copy(), np.zeros(len(places), int), np.arange(len(places))
    left, path = np.round(waits * len(steps)).astype(int), [start]
    for step in steps:
        way = places[every, leg] - here
        length = np.hypot(*way.T)
        there = length <= step
        moved = here + way * (step / np.maximum(length, 1e-12))[:, None]
        here = np.where(there[:, None], places[every, leg], moved)
        on = there & (left[every, leg] <= 0) & (leg < places.shape[1] - 1)
        left[every, leg] -= there
        leg = leg + on
        path.append(here)
    return np.stack(path, axis=1)


def climbed(
    box: Box, steps: Array, read: Bools, start: Array | None, rng: np.random.Generator, rounds: int = 25
) -> float:
    """The largest spread of many local searches."""
    low, high, best = np.array(box[::2]), np.array(box[1::2]), 0.0
    corners = np.where(rng.random((RUNS, LEGS, 2)) < 0.5, low, high)
    places = np.where(rng.random((RUNS, LEGS, 1)) < 0.6, corners, rng.uniform(low, high, (RUNS, LEGS, 2)))
    waits = rng.uniform(0, 0.5, (RUNS, LEGS)) * (rng.random((RUNS, LEGS)) < 0.5)
    for _ in range(rounds):
        begin = places[:, 0] if start is None else np.tile(start, (RUNS, 1))
        values = spread_of(followed(places, waits, begin, steps), read)
        best = max(best, float(values.max()))
        chosen = np.argsort(-values)[np.minimum(rng.geometric(0.2, RUNS) - 1, 19)]
        size = 10 ** rng.uniform(-3, 0, (RUNS, 1, 1)) * (rng.random((RUNS, LEGS, 1)) < 0.4)
        places = np.clip(places[chosen] + size * rng.normal(size=places.shape) * (high - low) / 2, low, high)
        waits = np.maximum(0, waits[chosen] + 0.3 * size[..., 0] * rng.normal(size=waits.shape))
    return best


def drawn_case(rng: np.random.Generator) -> tuple[Box, Array, Bools, Array | None]:
    samples = int(rng.integers(12, 70))
    box = (-rng.uniform(0.2, 2), rng.uniform(0.2, 2), -rng.uniform(0.2, 2), rng.uniform(0.2, 2))
    steps = rng.uniform(0.01, 0.25) * rng.uniform(0.3, 1.0, samples)
    read = np.zeros(samples + 1, bool)
    read[:: int(rng.integers(1, 4))] = True
    start = None if rng.random() < 0.3 else rng.uniform(box[::2], box[1::2])
    return box, steps, read, start


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_no_path_is_spread_further(seed: int) -> None:
    rng = np.random.default_rng(seed)
    box, steps, read, start = drawn_case(rng)
    begins = None if start is None else Start((float(start[0]), float(start[1])))
    found = largest_planar_spread(box, steps, read, begins, Effort(nodes=20))
    best = climbed(box, steps, read, start, rng)
    assert best <= found
    # As far apart as top speed allows along each axis for itself is further.
    first = (None, None) if start is None else (float(start[0]), float(start[1]))
    apart = sum(
        largest_spread(box[2 * axis], box[2 * axis + 1], first[axis], steps, read) for axis in range(2)
    )
    assert found <= 1.15 * apart


@pytest.mark.slow
def test_turning_out_of_the_first_heading_takes_time() -> None:
    steps, read = np.full(20, 0.2), np.ones(21, bool)
    box = (-1.0, 1.0, -1.0, 1.0)
    values = [
        largest_planar_spread(
            box, steps, read, Start((0.0, 0.0), 0.0, heading, 0.0, turning), Effort(nodes=10)
        )
        for heading, turning in ((0.0, 0.6), (np.pi / 4, 0.6), (0.0, 0.0))
    ]
    assert values[0] < 0.99 * values[1]
    # Not for the symmetry of that heading: where turning takes no way, paths come farther.
    assert values[0] < 0.97 * values[2]


@pytest.mark.parametrize(
    ("height", "step"), [(1e-8, 0.2), (0.0, 0.2), (1.0, 0.0)], ids=["thin", "line", "rest"]
)
def test_where_paths_have_no_area_to_be_in_nothing_is_known(height: float, step: float) -> None:
    room, read = (0.0, 1.0, 0.0, height), np.ones(21, bool)
    start = Start((0.0, 0.0)) if step == 0 else None
    assert largest_planar_spread(room, np.full(20, step), read, start, Effort(nodes=10)) == np.inf


def test_blocks_hold_every_reading_and_are_never_shorter_than_its_steps() -> None:
    rng = np.random.default_rng(0)
    for count in range(9, 40):
        distances = np.cumsum(rng.uniform(0, 1, count))
        for size in range(1, count // 4):
            first = int(rng.integers(1, count // size))
            parts = blocks(distances, size, first)
            assert sum(one.weight * one.count for one in parts) == count
            middle = distances[first * size - 1]
            for one in parts:
                assert one.middle == middle
                # The readings that one stands for are within its reach.
                assert one.before.sum() + one.to_middle >= middle - 1e-12
                if one.ends:
                    assert one.from_middle + one.after.sum() >= distances[-1] - middle - size


def laser_tracker(**design: Any) -> Any:
    return problem_of(
        design=DesignSpace(**{"duration": 6, "samples": 24, **design}),
        limits=(WheelSpeed(bounds=10), WheelAcceleration(bounds=20), Rectangle(x=(-0.4, 0.4), y=(-0.4, 0.4))),
        measurement=Poses(noise=AbsoluteNoise(position=0.01, heading=0.02)),
        estimate=("wheel_radius_right", "wheel_radius_left", "track"),
        criterion=E(scaling="relative"),
    )


@cache
def bounded() -> Certificate:
    """By few centres."""
    return bound(laser_tracker(), nodes=10)


@pytest.mark.slow
def test_certificates_of_positions_use_it_for_exact_and_widened_limits() -> None:
    found = bounded()
    assert found.method == PLANAR
    assert found.widened is not None
    assert found.widened.method == PLANAR
    assert found.upper_bound < found.widened.upper_bound < 1.03 * found.upper_bound
    assert any("heading" in one for one in found.assumptions)
    # Axis by axis is looser.
    assert found.bounds[1].value > 1.02 * found.upper_bound


@pytest.mark.slow
def test_the_laser_tracker_is_bounded_by_less_than_three_quarters_of_its_room(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Of as many readings as show it, by a third of the usual centres, on coarser grids.
    monkeypatch.setattr(planar, "COARSE", 28)
    monkeypatch.setattr(planar, "FINE", 80)
    study = oed.load_study(PROBLEMS / "laser_tracker.yaml").problem
    problem = replace(study, design=study.design.model_copy(update={"samples": 20}))
    found = bound(problem, nodes=80, workers=1).upper_bound * 3 * 0.01**2
    assert found < 0.75 * 21 * 2
    # Near what paths at top speed reach: 0.5 m in a second.
    steps, read, rng = np.full(20, 0.5), np.ones(21, bool), np.random.default_rng(0)
    best = climbed((-1.0, 1.0, -1.0, 1.0), steps, read, np.zeros(2), rng)
    assert best <= found <= 1.03 * best


@pytest.mark.slow
def test_a_search_that_is_out_of_time_says_so_and_is_looser() -> None:
    problem = laser_tracker()
    hurried, whole = bound(problem, time_limit=0.01), bounded()
    assert not hurried.complete
    assert whole.complete
    assert hurried.upper_bound >= whole.upper_bound
