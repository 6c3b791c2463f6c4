"""Dynamic programming over wheel speeds: known numbers, brute force, and what it hands back."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from builders import RADIUS, TRACK, problem_of

from oed.bounds import bound
from oed.bounds.lattice_program import LatticeProgram, SpeedLimits, lattice
from oed.bounds.speed_lattice import LatticeBound, lattice_bound
from oed.kernel.evaluation import evaluate
from oed.robots.limits import Rectangle, WheelAcceleration, WheelSpeed
from oed.robots.models import TractorTrailer
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace

Array = npt.NDArray[np.float64]

BOTH = np.full(2, 0.1)
NOTHING = np.zeros((2, 2))
PRIOR = np.array([[3.0, -1.0], [-1.0, 2.0]])


def limits(samples: int, bounds: Any = (-10.0, 10.0), step: float = 2.0, ends: float = np.inf) -> SpeedLimits:
    pairs = np.array(bounds, dtype=float)
    return SpeedLimits(samples, pairs if pairs.ndim == 2 else np.tile(pairs, (2, 1)), step, ends)


def smallest(speeds: Array, weights: Array, constant: Array = NOTHING) -> Array:
    """lambda_min of S (sum w w') S + constant, for speeds (..., N, 2)."""
    # By the formula for two rows and columns: most speeds are one of very many.
    first, second = np.moveaxis(speeds * weights, -1, 0)
    one, other = (first**2).sum(axis=-1) + constant[0, 0], (second**2).sum(axis=-1) + constant[1, 1]
    product = (first * second).sum(axis=-1) + constant[0, 1]
    return np.asarray((one + other) / 2 - np.hypot((one - other) / 2, product))


def assert_keeps(speeds: Array, allowed: SpeedLimits) -> None:
    assert speeds.shape == (allowed.samples, 2)
    assert np.all(speeds >= allowed.bounds[:, 0] - 1e-9)
    assert np.all(speeds <= allowed.bounds[:, 1] + 1e-9)
    assert np.all(np.abs(np.diff(speeds, axis=0)) <= allowed.step * (1 + 1e-6))
    assert np.all(np.abs(speeds[[0, -1]]) <= allowed.ends * (1 + 1e-9))


def assert_honest(
    found: LatticeBound, allowed: SpeedLimits, weights: Array, constant: Array = NOTHING
) -> None:
    """The best speeds keep the limits and have the value stated; the bounds are in order."""
    assert_keeps(found.speeds, allowed)
    assert smallest(found.speeds, weights, constant) == pytest.approx(found.lower, rel=1e-9, abs=1e-9)
    assert found.lower <= found.upper <= found.root * (1 + 1e-12)
    for part in found.parts:
        assert np.trace(part.multiplier) == pytest.approx(1.0)
        assert np.linalg.eigvalsh(part.multiplier)[0] >= -1e-9


def random_speeds(allowed: SpeedLimits, rng: np.random.Generator, count: int) -> Array:
    """Speeds (count, N, 2) within the limits, most of them at one."""
    low, high = allowed.bounds.T
    shape = (count, allowed.samples, 2)
    speeds = np.where(rng.random(shape) < 0.7, rng.choice([0.0, 1.0], shape), rng.random(shape))
    speeds = low + (high - low) * speeds
    step = min(allowed.step, 1e6)
    for index in range(1, allowed.samples):
        before = speeds[:, index - 1]
        speeds[:, index] = np.clip(speeds[:, index], before - step, before + step)
    if np.isfinite(allowed.ends):
        times = np.minimum(np.arange(allowed.samples), np.arange(allowed.samples)[::-1])
        reach = (allowed.ends + step * times)[:, None]
        speeds = np.clip(speeds, -reach, reach)
    return speeds


def walks_of_all(allowed: SpeedLimits) -> tuple[Array, Array]:
    """All speeds (count, N) of either wheel on a grid finer than the lattice that keep the limits."""
    found = []
    for low, high in allowed.bounds:
        more = [(2 * low + high) / 3]
        values = np.unique(np.concatenate([lattice(low, high, allowed.step, allowed.ends), more]))
        walks = np.array(list(itertools.product(values, repeat=allowed.samples)))
        kept = np.all(np.abs(np.diff(walks, axis=1)) <= allowed.step + 1e-9, axis=1)
        kept &= np.all(np.abs(walks[:, [0, -1]]) <= allowed.ends + 1e-9, axis=1)
        found.append(walks[kept])
    return found[0], found[1]


def corners_of_all(allowed: SpeedLimits) -> Array:
    """All speeds (count, N, 2) of both wheels on that grid."""
    grids = walks_of_all(allowed)
    first, second = np.meshgrid(np.arange(len(grids[0])), np.arange(len(grids[1])), indexing="ij")
    return np.stack([grids[0][first.ravel()], grids[1][second.ravel()]], axis=-1)


@pytest.mark.slow
def test_the_numbers_of_a_hundred_samples() -> None:
    allowed = limits(100, ends=0.0)
    found = lattice_bound(allowed, BOTH, NOTHING)
    assert_honest(found, allowed, BOTH)
    assert found.root == pytest.approx(92.40, abs=0.01)
    assert 85.80 <= found.upper <= 85.823
    assert found.lower == pytest.approx(85.8, abs=0.005)
    assert found.complete


@pytest.mark.slow
def test_forward_only() -> None:
    allowed = limits(100, (0.0, 10.0), ends=0.0)
    found = lattice_bound(allowed, BOTH, NOTHING)
    assert_honest(found, allowed, BOTH)
    assert found.root == pytest.approx(46.2, abs=0.01)
    assert found.upper <= 44.61
    assert found.lower == pytest.approx(44.6, abs=0.005)


@pytest.mark.slow
def test_few_nodes_leave_a_gap() -> None:
    allowed = limits(120, ends=0.0)
    found = lattice_bound(allowed, BOTH, NOTHING, nodes=8, time_limit=60.0)
    assert_honest(found, allowed, BOTH)
    assert not found.complete
    assert found.root == pytest.approx(112.4, abs=0.1)
    assert found.upper / found.lower - 1 < 0.06


@pytest.mark.slow
def test_no_time_at_all_still_gives_a_bound() -> None:
    allowed = limits(30, ends=1.0)
    hurried = lattice_bound(allowed, BOTH, NOTHING, time_limit=0.0)
    assert not hurried.complete
    assert_honest(hurried, allowed, BOTH)
    assert hurried.upper >= lattice_bound(allowed, BOTH, NOTHING, nodes=4).lower


TINY = [
    limits(3, (-2.0, 2.0), 2.0),
    limits(4, (-2.0, 2.0), 2.0, 1.0),
    limits(4, (0.0, 2.0), 1.0, 0.5),
    limits(4, (-1.0, 3.0), 2.0),
    limits(3, ((-1.0, 3.0), (0.0, 2.0)), 1.5),
    limits(4, (-3.0, 3.0), np.inf),
    limits(3, (1.0, 3.0), 1.0),
]


# And of equal weights some where both ways are as good, and some where they are not.
@pytest.mark.slow
@pytest.mark.parametrize(("place", "second"), [*((one, 0.4) for one in range(len(TINY))), (1, 1.0), (3, 1.0)])
def test_bounds_hold_what_enumeration_finds(place: int, second: float) -> None:
    allowed, weights = TINY[place], np.array([1.0, second])
    everything = corners_of_all(allowed)
    found = lattice_bound(allowed, weights, NOTHING, nodes=8)
    assert_honest(found, allowed, weights)
    best = smallest(everything, weights).max()
    assert best <= found.upper * (1 + 1e-9)
    assert found.lower <= best * (1 + 1e-9) or not found.complete
    # A duality gap stays where there are too few samples to mix drives.
    assert found.upper <= 1.5 * best


@pytest.mark.slow
@pytest.mark.parametrize("place", [0, 2, 4])
@pytest.mark.parametrize("nodes", [3, 300], ids=["some", "all"])
def test_the_parts_of_a_search_hold_all_speeds(place: int, nodes: int) -> None:
    allowed, weights = TINY[place], np.array([1.0, 0.4])
    everything, middle = corners_of_all(allowed), allowed.bounds.mean(axis=1)
    # No gap is small enough: branchings go on until all signs are known, of all that are allowed.
    found = lattice_bound(allowed, weights, NOTHING, gap=-1.0, nodes=nodes)
    held = np.zeros(len(everything), dtype=bool)
    for part in found.parts:
        signs = np.zeros((allowed.samples, 2))
        for moment, pair in part.conditions.items():
            signs[moment] = pair
        # What is the same the other way round is left out where both ways are allowed.
        for way in (1, -1) if allowed.symmetric else (1,):
            held |= (way * signs * (everything - middle) >= -1e-9).all(axis=(1, 2))
    assert held.all()
    assert found.bound_for(allowed, weights, NOTHING) <= found.upper * (1 + 1e-9)


@pytest.mark.parametrize("allowed", TINY, ids=range(len(TINY)))
@pytest.mark.slow
def test_the_largest_trace_is_that_of_enumeration(allowed: SpeedLimits) -> None:
    everything = corners_of_all(allowed)
    rng = np.random.default_rng(0)
    weights = np.array([1.0, 0.7])
    program = LatticeProgram(allowed, weights)
    for _ in range(5):
        factor = rng.normal(size=(2, 2))
        matrix = factor @ factor.T / np.trace(factor @ factor.T)
        value, path = program.maximise(matrix, {})
        scaled = everything * weights
        best = np.einsum("ski,ij,skj->s", scaled, matrix, scaled).max()
        assert value == pytest.approx(best, rel=1e-9)
        assert np.einsum("ki,ij,kj", path, matrix, path) == pytest.approx(value, rel=1e-9)
        assert_keeps(path / weights, allowed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bounds", "step", "ends", "constant"),
    [
        ((-10.0, 10.0), 3.7, np.inf, PRIOR),
        ((-10.0, 10.0), 0.73, 0.365, NOTHING),
        ((-3.0, 8.0), 2.1, 1.05, PRIOR),
        ((-3.0, 8.0), np.inf, np.inf, NOTHING),
        (((-1.0, 5.0), (0.0, 7.0)), 1.3, 0.65, PRIOR),
        ((2.0, 9.0), 1.9, np.inf, PRIOR),
    ],
)
def test_no_speeds_beat_the_bound(bounds: Any, step: float, ends: float, constant: Array) -> None:
    rng = np.random.default_rng(1)
    # Of so few samples drawn speeds come near the bound.
    allowed, weights = limits(8, bounds, step, ends), np.array([0.3, 0.2])
    found = lattice_bound(allowed, weights, constant, nodes=12)
    assert_honest(found, allowed, weights, constant)
    drawn = random_speeds(allowed, rng, 4000)
    for speeds in drawn[:5]:
        assert_keeps(speeds, allowed)
    assert smallest(drawn, weights, constant).max() <= found.upper
    climbed = drawn[int(np.argmax(smallest(drawn, weights, constant)))]
    for _ in range(20):
        moved = np.clip(climbed + rng.normal(0, 0.3, (300, *climbed.shape)), *allowed.bounds.T)
        kept = np.all(np.abs(np.diff(moved, axis=1)) <= allowed.step, axis=(1, 2))
        kept &= np.all(np.abs(moved[:, [0, -1]]) <= allowed.ends, axis=(1, 2))
        values = np.where(kept, smallest(moved, weights, constant), -np.inf)
        if values.max() > smallest(climbed, weights, constant):
            climbed = moved[int(np.argmax(values))]
    assert smallest(climbed, weights, constant) <= found.upper


def test_without_a_step_the_bound_is_static() -> None:
    allowed = limits(20, step=np.inf)
    found = lattice_bound(allowed, BOTH, NOTHING, time_limit=0.5)
    assert_honest(found, allowed, BOTH)
    assert found.upper == pytest.approx(20.0, rel=1e-3)


def test_without_a_step_half_the_time_each_way_is_found() -> None:
    found = lattice_bound(limits(20, step=np.inf), BOTH, NOTHING, time_limit=0.5)
    assert found.lower == pytest.approx(20.0, rel=1e-3)
    assert found.complete


def test_the_lattice_holds_all_bounds_and_steps_from_them() -> None:
    values = lattice(-3.0, 8.0, 2.0, 1.0)
    assert np.all(np.diff(values) > 0)
    assert values[0] == -3.0
    assert values[-1] == 8.0
    for value in (-3, -1, 1, 3, 5, 7, 8, 6, 4, 2, 0, -2, 2.5, 0.5):
        assert np.isclose(values, value).any()
    # At the ends of a drive either sign may be largest, whatever the step.
    for value in (0.7, -0.7):
        assert np.isclose(lattice(-3.0, 8.0, 2.0, 0.7), value).any()
    assert list(lattice(0.0, 10.0, np.inf, np.inf)) == [0.0, 5.0, 10.0]


@pytest.mark.slow
@pytest.mark.parametrize(("integration", "loss"), [("midpoint", 3e-4), ("arc", 0.03)])
def test_the_certificate_hands_back_a_drive_of_its_own_value(integration: Any, loss: float) -> None:
    """Arcs tell a little less than chords of full length."""
    problem = problem_of(
        design=DesignSpace(duration=2, samples=20, integration=integration),
        measurement=Displacements(segments="samples"),
        limits=(WheelSpeed(bounds=10), WheelAcceleration(bounds=40)),
    )
    # As long as it takes: a busy machine must not end the search early.
    certificate = bound(problem, time_limit=120)
    assert certificate.drive is not None
    found = evaluate(problem, certificate.drive)
    assert found.feasible
    assert certificate.complete
    assert 0 <= certificate.gap(found.objective) <= loss
    assert not certificate.loose(found.objective)


@pytest.mark.slow
def test_the_lattices_drive_of_a_robot_with_further_states() -> None:
    problem = problem_of(
        model=TractorTrailer(wheel_radius=0.05, track=0.2, trailer_length=0.4),
        duration=1,
        samples=8,
        coefficients=6,
        start="free",
        measurement=Displacements(segments="samples", noise_model="increments"),
        limits=(WheelSpeed(bounds=5), WheelAcceleration(bounds=20)),
    )
    drive = bound(problem, nodes=5).drive
    assert drive.starts.shape == (1, 4)
    assert evaluate(problem, drive).objective > 0


def test_the_lattices_drive_keeps_the_speeds_even_where_it_leaves_the_room() -> None:
    # Half the time it turns by a quarter and a whole turn, to a wall at its left, or it begins straight at
    # that ahead. It could only go back to where there is room a little faster than it may.
    low, high = -7.9, 8.0
    turning = (high - low) * RADIUS / TRACK
    problem = problem_of(
        design=DesignSpace(duration=2 * 2.5 * np.pi / turning, samples=8, start={"x": 0, "y": 0}),
        measurement=Displacements(segments="samples"),
        limits=(WheelSpeed(bounds=(low, high)), Rectangle(x=(-9, 0.05), y=(-0.05, 0.05))),
    )
    drive = bound(problem, nodes=1).drive
    assert not evaluate(problem, drive).feasible
    assert np.all((low - 1e-9 <= drive.inputs) & (drive.inputs <= high + 1e-9))


@pytest.mark.parametrize(
    ("x", "y"),
    [((-0.1, 9), (-0.1, 0.1)), ((-9, 0.1), (-0.1, 0.1)), ((-0.1, 0.7), (-9, 9)), ((-0.7, 0.1), (-9, 9))],
    ids=["ahead", "behind", "aside and ahead", "aside and behind"],
)
def test_the_lattices_drive_goes_to_where_there_is_room(x: Any, y: Any) -> None:
    # Half the time it turns, by 60 degrees more than once around, before it drives straight or after that.
    speed, angle = 8.0, 2 * np.pi + np.pi / 3
    half = angle * TRACK / (2 * speed * RADIUS)
    way = speed * RADIUS * half
    problem = problem_of(
        design=DesignSpace(duration=2 * half, samples=8, start={"x": 0, "y": 0, "heading": 0}),
        measurement=Displacements(segments="samples"),
        limits=(WheelSpeed(bounds=speed), Rectangle(x=way * np.array(x), y=way * np.array(y))),
    )
    assert evaluate(problem, bound(problem, nodes=1).drive).feasible
