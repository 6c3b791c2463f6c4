"""Closed-form bounds: their values, when they are left out, and what they say of themselves."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builders import (
    ACCELERATION,
    BOX,
    RADIUS,
    SPEED,
    TRACK,
    make_flagship,
    problem_of,
    random_drive,
    upper_bound,
)
from hypothesis import given
from hypothesis import strategies as st
from places import PROBLEMS

from oed.bounds import NOTHING, OF_E, ROOMLESS, Certificate, bound
from oed.bounds.certificate import INFLATION, OF_ALL
from oed.bounds.closed_form import TURNED, largest_squares, regression_bounds, turning_eigenvalue_bound
from oed.kernel.criteria import A, E, ModifiedE
from oed.kernel.evaluation import evaluate
from oed.kernel.measurement.prior import Prior
from oed.robots.limits import PathLength, Rectangle
from oed.robots.models import DifferentialDrive
from oed.robots.sensors import Displacements, Poses, Ranges, Several
from oed.robots.sensors.displacements import PoseNoise
from oed.robots.sensors.poses import AbsoluteNoise
from oed.robots.space import DesignSpace
from oed.workflow.studies import load_study

COEFFICIENTS = ("c11", "c12", "c21", "c22")
LENGTHS = ("wheel_radius_right", "wheel_radius_left", "track")
SIGMA = 0.01
NOISE = AbsoluteNoise(position=SIGMA, heading=0.02)
SHORT = DesignSpace(duration=4, samples=8)


def methods(certificate: Certificate, words: str) -> list[float]:
    """Values of the bounds whose method holds these words."""
    return [one.value for one in certificate.bounds if words in one.method]


def tracker(**overrides: Any) -> Certificate:
    """The certificate of the paper's robot with poses as readings."""
    parts: dict[str, Any] = {
        "measurement": Poses(noise=NOISE),
        "estimate": LENGTHS,
        "criterion": E(scaling="relative"),
    }
    return bound(make_flagship(**{**parts, **overrides}))


def test_the_flagships_bound() -> None:
    certificate = bound(make_flagship())
    assert certificate.upper_bound == pytest.approx(upper_bound(10), rel=2 * INFLATION)
    assert "diameter" in certificate.method
    assert certificate.complete
    assert certificate.drive is None


@pytest.mark.parametrize("segments", [1, 3, 25])
def test_the_cap_is_that_of_every_number_of_segments(segments: int) -> None:
    certificate = bound(make_flagship(measurement=Displacements(segments=segments)))
    assert methods(certificate, "diameter") == [pytest.approx(upper_bound(segments), rel=2 * INFLATION)]


def test_the_cap_of_unequal_radii() -> None:
    right, left = 0.06, 0.03
    model = DifferentialDrive(wheel_radius_right=right, wheel_radius_left=left, track=TRACK)
    expected = 4 * 10 * TRACK**2 / (right**2 + left**2)
    assert methods(bound(make_flagship(model=model)), "diameter") == [pytest.approx(expected)]


def test_the_cap_relative_to_the_nominal_values() -> None:
    """A relative direction (1, -1) / sqrt 2 of radii turns by B per length; noise is in units of sigma."""
    measurement = Displacements(segments=10, noise=PoseNoise(position=0.02))
    certificate = bound(make_flagship(measurement=measurement, criterion=E(scaling="relative")))
    # u / S = (r / B)(1, -1) / ((r / 2) / sigma) = 2 sigma / B (1, -1): 4 P / |u / S|^2.
    expected = 40 / (8 * 0.02**2 / TRACK**2)
    assert methods(certificate, "diameter") == [pytest.approx(expected)]


def test_midpoint_chords_have_no_diameter() -> None:
    design = DesignSpace(duration=20, integration="midpoint")
    certificate = bound(make_flagship(design=design))
    assert not methods(certificate, "diameter")
    assert np.isfinite(certificate.upper_bound)


@pytest.mark.parametrize("side", [0.1, 100.0])
def test_a_segment_ends_no_farther_away_than_in_the_opposite_corner_of_the_room(side: float) -> None:
    certificate = bound(make_flagship(limits=(SPEED, Rectangle(x=(0, side), y=(0, side)))))
    (found,), (by_speed,) = (
        methods(certificate, "room's diagonal"),
        methods(certificate, "longer than the top"),
    )
    assert found == pytest.approx(min(by_speed, 10 * 2 * side**2 * 2 / RADIUS**2))
    # The small room is what counts, in the large one speed is.
    assert (found < by_speed) == (side < 1)


def test_absolute_noise_is_not_bounded() -> None:
    measurement = Displacements(segments=10, noise=PoseNoise(position=0.02), noise_model="absolute")
    certificate = bound(make_flagship(measurement=measurement, criterion=E(scaling="relative")))
    assert certificate.upper_bound == np.inf
    assert certificate.method == NOTHING


def test_joint_coefficients() -> None:
    certificate = tracker(estimate=COEFFICIENTS)
    expected = 201 * TRACK**2 / (8 * SIGMA**2)
    assert certificate.upper_bound == pytest.approx(expected, rel=2 * INFLATION)


def test_joint_coefficients_of_a_start_known_may_lie_twice_as_far() -> None:
    measurement = Poses(noise=NOISE, initial_pose="known")
    certificate = tracker(measurement=measurement, estimate=COEFFICIENTS)
    expected = 4 * 201 * TRACK**2 / (8 * SIGMA**2)
    assert certificate.upper_bound == pytest.approx(expected, rel=2 * INFLATION)


def test_joint_coefficients_may_lie_twice_as_far_where_ranges_are_read_as_well() -> None:
    ranges = Ranges(beacons=((3.0, 0.0), (0.0, 3.0)), noise=SIGMA)
    certificate = tracker(measurement=Several(sensors=(Poses(noise=NOISE), ranges)), estimate=COEFFICIENTS)
    expected = 4 * (1 + len(ranges.beacons)) * 201 * TRACK**2 / (8 * SIGMA**2)
    assert certificate.upper_bound == pytest.approx(expected, rel=2 * INFLATION)


@pytest.mark.slow
def test_joint_lengths() -> None:
    certificate = tracker(design=DesignSpace(duration=20, samples=20))
    loosest = 21 * 2 / (3 * SIGMA**2)
    assert methods(certificate, "corner") == [pytest.approx(loosest, rel=2 * INFLATION)]
    assert certificate.upper_bound < 0.80 * loosest
    assert "top speed" in certificate.method


@pytest.mark.slow
def test_joint_lengths_count_the_readings() -> None:
    certificate = tracker(design=SHORT, measurement=Poses(noise=NOISE, every=4))
    assert methods(certificate, "corner") == [pytest.approx(3 * 2 / (3 * SIGMA**2))]


@pytest.mark.slow
def test_joint_lengths_of_a_room_of_any_shape() -> None:
    box = Rectangle(x=(-1, 3), y=(0, 1))
    found = methods(tracker(design=SHORT, limits=(SPEED, box)), "corner")
    assert found == [pytest.approx(9 * (2**2 + 0.5**2) / (3 * SIGMA**2))]


@pytest.mark.parametrize("pose", ["known", {"position": 0.01, "heading": 0.02}])
def test_a_start_that_is_known_has_no_centred_bound(pose: Any) -> None:
    certificate = tracker(measurement=Poses(noise=NOISE, initial_pose=pose))
    assert certificate.bounds == ()
    assert certificate.upper_bound == np.inf


def test_no_room_no_bound() -> None:
    assert tracker(limits=(SPEED,)).bounds == ()


@pytest.mark.slow
def test_ranges_tell_no_more_than_all_beacons_in_line() -> None:
    beacons = ((3.0, 0.0), (0.0, 3.0), (-3.0, 0.0))
    certificate = tracker(design=SHORT, measurement=Ranges(beacons=beacons, noise=SIGMA))
    assert methods(certificate, "corner") == [pytest.approx(3 * 9 * 2 / (3 * SIGMA**2))]


@pytest.mark.slow
def test_a_prior_adds_what_it_knows() -> None:
    without = tracker(design=SHORT).upper_bound
    shares = dict.fromkeys(LENGTHS, "1 %")
    with_prior = tracker(design=SHORT, prior=Prior(standard_deviations=shares)).upper_bound
    assert with_prior == pytest.approx(without + 1e4, rel=1e-6)


POSES = Poses(noise={"position": "1 cm", "heading": "1 deg"})


@pytest.mark.parametrize(
    ("criterion", "measurement"),
    [
        (ModifiedE(), Displacements(segments=4)),
        (ModifiedE(), Displacements(segments="samples")),
    ],
)
def test_other_criteria_have_no_bound(criterion: Any, measurement: Any) -> None:
    criterion = criterion.model_copy(update={"scaling": "none"})
    certificate = bound(problem_of(criterion=criterion, measurement=measurement, limits=(SPEED, BOX)))
    assert certificate.upper_bound == np.inf
    assert certificate.method == OF_E
    assert certificate.bounds == ()
    assert certificate.loose(1.0)


@pytest.mark.slow
def test_variances_add_up_to_more_than_that_of_one_direction() -> None:
    given = {"measurement": POSES, "limits": (SPEED, BOX), "samples": 8}
    smallest = bound(problem_of(criterion=E(), **given), nodes=4)
    certificate = bound(problem_of(criterion=A(), **given), nodes=4)
    assert -0.9 / smallest.upper_bound > certificate.upper_bound > -1.1 / smallest.upper_bound


@pytest.mark.slow
@pytest.mark.parametrize("runs", [1, 2])
def test_a_room_that_is_lacking_is_asked_for(runs: int) -> None:
    sensor = Poses(noise={"position": "1 cm", "heading": "1 deg"})
    given = {"measurement": sensor, "design": DesignSpace(duration=2, samples=4, runs=runs)}
    assert bound(problem_of(limits=(SPEED,), **given), nodes=4).method == ROOMLESS
    assert np.isfinite(bound(problem_of(limits=(SPEED, BOX), **given), nodes=1).upper_bound)


def test_caps_are_in_order_and_name_what_they_rest_on() -> None:
    certificate = bound(problem_of(limits=(SPEED, BOX)))
    values = [one.value for one in certificate.bounds]
    assert values == sorted(values)
    assert certificate.upper_bound == values[0]
    assert all(one.assumptions and one.method for one in certificate.bounds)
    assert certificate.assumptions == (*OF_ALL, *certificate.bounds[0].assumptions)
    assert certificate.widened.assumptions[: len(OF_ALL)] == OF_ALL
    said = " ".join(OF_ALL)
    assert all(word in said for word in ("nominal", "duration", "held inputs", "linearised", "rounding"))
    for one in certificate.bounds:
        assert one.multiplier is not None
        assert np.trace(one.multiplier) == pytest.approx(1.0)
        assert np.linalg.eigvalsh(one.multiplier)[0] >= -1e-12


def test_a_certificate_says_how_long_it_took() -> None:
    began = time.perf_counter()
    certificate = bound(problem_of(limits=(SPEED, BOX)))
    assert 0 < certificate.wall_seconds <= time.perf_counter() - began


def test_the_gap_of_an_objective() -> None:
    certificate = bound(make_flagship())
    assert certificate.gap(upper_bound(10) / 1.1) == pytest.approx(0.1)
    assert certificate.loose(upper_bound(10) / 1.1)
    assert not certificate.loose(upper_bound(10) / 1.01)
    assert certificate.gap(0.0) == np.inf


def test_the_same_bound_on_the_track_of_the_paper() -> None:
    assert upper_bound(10) == pytest.approx(20 * (TRACK / RADIUS) ** 2)


@pytest.mark.slow
def test_a_path_budget_is_spent_in_the_longest_segments() -> None:
    # Per sample 2 T wmax L / r, for L shorter than what the top speed allows. [F++ = 2 T^2 sum V^2 / r^2]
    space = DesignSpace(duration=10, samples=100, rest_to_rest=False)
    budget, period, top = 1.47, 0.1, 10.0
    problem = problem_of(
        design=space,
        measurement=Displacements(segments="samples"),
        limits=(SPEED, PathLength(bounds=budget)),
    )
    expected = 2 * period * top * budget / RADIUS
    assert methods(bound(problem), "no more path") == [pytest.approx(expected, rel=2 * INFLATION)]
    without = problem_of(design=space, measurement=Displacements(segments="samples"), limits=(SPEED,))
    assert methods(bound(without), "no more path") == []


@pytest.mark.slow
@given(
    lengths=st.lists(st.floats(0.0, 5.0), min_size=1, max_size=6),
    shares=st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6),
    budget=st.floats(0.0, 12.0),
)
def test_no_other_way_to_spend_it_has_a_larger_sum_of_squares(lengths, shares, budget) -> None:
    spent = np.array(lengths) * np.array(shares[: len(lengths)])
    spent *= min(1.0, budget / spent.sum()) if spent.sum() > 0 else 1.0
    assert (spent**2).sum() <= largest_squares(np.array(lengths), budget) + 1e-9


@pytest.mark.slow
def test_no_drive_within_the_budget_beats_it() -> None:
    problem = problem_of(
        limits=(SPEED, ACCELERATION, PathLength(bounds=0.6)), measurement=Displacements(segments=4)
    )
    upper = bound(problem).upper_bound
    tried = 0
    for seed in range(70, 100):
        drive = random_drive(problem, seed, amplitude=1.0 + seed % 9)
        found = evaluate(problem, drive)
        if all(margin.violation <= 1e-12 for margin in found.margins):
            tried += 1
            assert found.objective <= upper
    assert tried > 10


@pytest.mark.slow
def test_no_angles_say_more_than_one_input_that_turns_round() -> None:
    # All sequences of corners of what two inputs may be, and random ones, within their steps.
    # Of this seed several come as far as is said.
    rng = np.random.default_rng(2)
    for _ in range(15):
        segments, each = int(rng.integers(2, 6)), int(rng.integers(1, 5))
        edges = each * np.arange(segments + 1)
        reach = rng.uniform(0.5, 1.5) * np.ones((segments * each, 2))
        reach[0] = reach[-1] = rng.uniform(0.2, 1.0) * reach[1]
        steps = rng.uniform(0.2, 2.5, 2)
        most = turning_eigenvalue_bound(reach, steps, edges)
        signs = rng.choice([-1.0, 1.0], (4000, segments, 2))
        wanted = np.repeat(signs, each, axis=1) * np.where(rng.random((4000, 1, 1)) < 0.8, 1.0, rng.random())
        wanted = np.roll(wanted, int(rng.integers(-1, 2)), axis=1) * reach
        drives = wanted.copy()
        for index in range(1, drives.shape[1]):
            before = drives[:, index - 1]
            drives[:, index] = np.clip(wanted[:, index], before - steps, before + steps)
        sums = np.add.reduceat(drives, edges[:-1], axis=1)
        found = np.linalg.eigvalsh(np.swapaxes(sums, 1, 2) @ sums)[:, 0]
        assert found.max() <= most * (1 + 1e-12)
        assert most <= (np.add.reduceat(reach, edges[:-1]) ** 2).sum() / 2 + 1e-12


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_angles_of_another_size_say_as_much_more_as_their_squares(scale: float) -> None:
    rng = np.random.default_rng(1)
    for segments in range(3, 8):
        edges = 3 * np.arange(segments + 1)
        reach, steps = rng.uniform(0.5, 1.5, (3 * segments, 2)), rng.uniform(0.02, 0.1, 2)
        most = turning_eigenvalue_bound(reach, steps, edges)
        # Less than where neither turns round.
        assert most < 0.95 * (np.add.reduceat(reach, edges[:-1]) ** 2).sum() / 2
        assert turning_eigenvalue_bound(scale * reach, scale * steps, edges) == pytest.approx(
            scale**2 * most, rel=1e-9
        )


@pytest.mark.slow
def test_headings_are_bounded_by_an_input_that_turns_round() -> None:
    problem = load_study(PROBLEMS / "heading.yaml").problem
    by_method = {one.method: one.value for one in regression_bounds(problem)}
    assert by_method[TURNED] < 0.985 * max(by_method.values())
    # Runs of which each turns one way say more together than the sum of what they say alone.
    several = replace(problem, design=problem.design.model_copy(update={"runs": 2}))
    assert all(one.method != TURNED for one in bound(several, nodes=1).bounds)
