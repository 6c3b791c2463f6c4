"""Limits widened by what scoring tolerates: their bound, and which bound a drive is held against."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from builders import ACCELERATION, BOX, SPEED, problem_of, random_drive
from drives import KINDS, wanted_speeds, within_limits

from oed.bounds import LATTICE, bound, smallest
from oed.bounds.certificate import Bound
from oed.bounds.reach import largest_rates, workspace_bounds
from oed.kernel.dynamics.rollout import Drive
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.limit import BareLimit, Rows
from oed.kernel.problem import Problem
from oed.kernel.results import TOLERANCE, Evaluation
from oed.kernel.solution import scored
from oed.records.outcomes import certificate_of
from oed.robots.limits import (
    BodySpeed,
    Circle,
    CircularObstacle,
    EndHeading,
    EndPosition,
    LateralAcceleration,
    Obstacles,
    PathLength,
    Polygon,
    TurningRadius,
    WheelAcceleration,
    WheelJerk,
    WheelSpeed,
    YawRate,
)
from oed.robots.models import Model
from oed.robots.sensors import Displacements, Poses
from oed.robots.sensors.poses import AbsoluteNoise
from oed.robots.space import DesignSpace
from oed.workflow.certificates import certified


class RevolutionsPerMinute(BareLimit):
    """A user's own limit, in a unit of its own."""

    name: ClassVar[str] = "motor_speed"
    bounds: float

    def rows(self, drive: Drive) -> Rows:
        values = drive.input_values[:, 0] * (30 / np.pi)
        bound = np.full(drive.input_values.shape[0], self.bounds)
        return Rows(values, -bound, bound, self.bounds, "1/min")

    def input_bounds(self, model: Model) -> dict[str, tuple[float, float]]:
        largest = self.bounds * np.pi / 30
        return {model.input_names[0]: (-largest, largest)}


EVERY_LIMIT = (
    SPEED,
    ACCELERATION,
    WheelJerk(bounds=50),
    BodySpeed(bounds=0.4),
    YawRate(bounds=3),
    LateralAcceleration(bounds=0.5),
    TurningRadius(bounds=0.2),
    BOX,
    Obstacles(shapes=(CircularObstacle(x=0.5, y=0.5, radius=0.1),)),
    PathLength(bounds=3),
    EndPosition(at="start"),
    EndHeading(at=0.0),
    RevolutionsPerMinute(bounds=60),
)


@pytest.mark.parametrize("seed", range(3))
def test_every_margin_grows_by_the_tolerance(seed: int):
    """So a drive is feasible if and only if it satisfies the widened limits exactly."""
    problem = problem_of(limits=EVERY_LIMIT)
    drive = replace(random_drive(problem, seed), start=np.array([0.001, 0.0, 0.0]))
    plain = evaluate(problem, drive).margins
    wider = evaluate(problem.widened(TOLERANCE), drive).margins
    assert [one.name for one in wider] == [one.name for one in plain]
    for one, other in zip(plain, wider, strict=True):
        assert other.margin == pytest.approx(one.margin + TOLERANCE * one.size, abs=1e-5 * one.size)


def test_bounds_of_inputs_are_widened_as_their_rows_are():
    limits = (
        WheelSpeed(bounds=(-3, 8)),
        WheelAcceleration(bounds=(-30, 10)),
        RevolutionsPerMinute(bounds=60),
    )
    problem = problem_of(limits=limits).widened(0.1)
    assert problem.input_bounds[1] == pytest.approx([-3.8, 8.8])
    # Of the first input the smaller of 2 pi rad/s, given as 60 a minute, widened by at least a tenth.
    assert problem.input_bounds[0, 1] >= 1.1 * 2 * np.pi
    assert largest_rates(problem) == pytest.approx([33.0, 33.0])


SHARP = Polygon(points=((0, 0), (2, -0.1), (2, 0.3)))


@pytest.mark.parametrize("area", [BOX, Circle(radius=0.9), SHARP], ids=["box", "circle", "sharp"])
def test_a_widened_room_holds_every_point_that_is_tolerated(area: Any):
    rng = np.random.default_rng(0)
    problem = problem_of(limits=(SPEED, area), design=DesignSpace(duration=10, samples=40, start="free"))
    for share in (0.02, 0.3):
        x_min, x_max, y_min, y_max = workspace_bounds(problem.widened(share))
        points = rng.uniform(-4, 4, (20000, 2))
        rows = area.rows_for(points, 0.0)
        values = np.array(rows.expression).reshape(-1)
        margins = np.minimum(values - rows.lower, rows.upper - values).reshape(-1, len(points)).min(axis=0)
        inside = points[margins >= -share * rows.size]
        assert len(inside)
        assert np.all(inside.min(axis=0) >= [x_min - 1e-9, y_min - 1e-9])
        assert np.all(inside.max(axis=0) <= [x_max + 1e-9, y_max + 1e-9])


def test_the_sharp_corner_of_a_widened_room_is_farther_than_its_walls():
    by = 0.1 * 0.2
    (x_min, *_), half = SHARP.widened_extent(0.1), np.arctan2(0.4, 2) / 2
    assert x_min < -by / np.sin(2 * half)
    assert SHARP.widened_extent(0.0) == pytest.approx(SHARP.extent)


ALL_BUT = TOLERANCE * (1 - 1e-6)
"""As much as is tolerated, but for rounding."""


@pytest.fixture(scope="module")
def hundred() -> Any:
    """The per-sample form of 100 samples, and its certificate."""
    problem = problem_of(
        samples=100,
        coefficients=30,
        start="free",
        integration="midpoint",
        measurement=Displacements(segments="samples"),
        limits=(SPEED, ACCELERATION),
    )
    return problem, bound(problem)


def scored_drive(problem: Problem, speeds: Any, longer: float = 0.0) -> Evaluation:
    duration = (1 + longer) * problem.design.duration
    return evaluate(problem, Trajectory.from_samples(speeds, duration, np.zeros(3)))


@pytest.mark.slow
def test_the_exact_bound_is_exceeded_within_the_tolerance_and_the_widened_one_is_not(hundred):
    problem, certificate = hundred
    assert certificate.upper_bound == pytest.approx(86.702, abs=0.001)
    faster = scored_drive(problem, (1 + ALL_BUT) * certificate.drive.inputs)
    assert faster.feasible
    assert faster.objective == pytest.approx(86.87, abs=0.01)
    assert certificate.upper_bound < faster.objective <= certificate.widened.upper_bound
    assert certificate.bound_on(faster) == certificate.widened.upper_bound
    # What takes longer by as much is feasible too.
    longer = scored_drive(problem, (1 + ALL_BUT) * certificate.drive.inputs, ALL_BUT)
    assert longer.feasible
    assert 87.0 < longer.objective <= certificate.widened.upper_bound <= 1.0005 * longer.objective


@pytest.mark.slow
def test_what_satisfies_the_limits_exactly_is_held_against_the_exact_bound(hundred):
    problem, certificate = hundred
    exact = scored_drive(problem, certificate.drive.inputs)
    assert certificate.bound_on(exact) == certificate.upper_bound
    assert 0 <= certificate.gap(exact.objective) <= 2e-4


@pytest.mark.slow
def test_no_drive_within_the_tolerance_beats_the_widened_bound(hundred):
    problem, certificate = hundred
    wider, rng = problem.widened(ALL_BUT), np.random.default_rng(2)
    best, found = (1 + ALL_BUT) * certificate.drive.inputs, []
    for index in range(80):
        wanted = wanted_speeds(wider, KINDS[index % len(KINDS)], rng)
        size = 1.0 if index < 20 else 0.1 ** rng.uniform(1, 4)
        speeds = within_limits(wider, size * wanted + (best if index >= 20 else 0.0))
        evaluation = scored_drive(problem, speeds, ALL_BUT)
        if evaluation.feasible:
            found.append(evaluation.objective)
    assert len(found) > 60
    assert certificate.upper_bound < max(found) <= certificate.widened.upper_bound


@pytest.mark.slow
def test_gaps_are_never_negative(hundred):
    problem, certificate = hundred
    for excess in (0.0, ALL_BUT / 2, ALL_BUT):
        found = scored_drive(problem, (1 + excess) * certificate.drive.inputs)
        data = certificate_of(certificate, found, LATTICE, None)
        assert found.feasible
        assert 0 <= data.gap < 0.005
        assert (data.gap_to == data.upper_bound) == (excess == 0.0)
        assert data.gap == pytest.approx(data.gap_to / found.objective - 1)
        assert data.widened.tolerance == TOLERANCE
        assert "exactly" in data.assumptions[-2]
        assert "tolerates" in data.widened.assumptions[-2]


@pytest.mark.slow
def test_positions_and_starts_within_the_tolerance():
    """Poses of a path along the room's diagonal, moved beyond its corners and away from its start."""
    poses = Poses(noise=AbsoluteNoise(position=0.01, heading=0.02))
    problem = problem_of(
        measurement=poses,
        design=DesignSpace(duration=8, samples=24, rest_to_rest=False, start={"x": -1, "y": -1}),
        limits=(WheelSpeed(bounds=10), BOX),
    )
    certificate = bound(problem, nodes=20)
    assert certificate.upper_bound <= certificate.widened.upper_bound <= 1.01 * certificate.upper_bound
    assert certificate.widened.upper_bound / certificate.upper_bound - 1 == pytest.approx(4e-3, abs=2e-3)
    methods = [one.method for one in certificate.bounds]
    assert [one.method for one in certificate.widened.bounds] == methods
    # One corner and the other, as far out as is tolerated.
    assert certificate.widened.bounds[-1].value == pytest.approx(
        certificate.bounds[-1].value * (1 + TOLERANCE) ** 2, rel=1e-6
    )


def test_drives_of_several_runs_are_held_against_their_bound():
    problem = problem_of(runs=2)
    drive = random_drive(problem, 1, 0.5)
    assert evaluate(problem, drive).feasible
    found = certified(SimpleNamespace(problem=problem), bound(problem), [scored(problem, drive, "mine")])
    assert found.best == evaluate(problem, drive).objective
    assert found.gap > 0


def test_bound_under_wider_limits_holds_under_the_limits_too(monkeypatch: pytest.MonkeyPatch):
    # Bounds were paired by their sentences: one that reads otherwise under wider limits was left out.
    def bounds_of(problem: Problem) -> Iterator[Bound]:
        wider = bool(problem.excess)
        yield Bound(1.0 if wider else 2.0, "wider limits" if wider else "limits", ())

    monkeypatch.setattr(smallest, "BOUNDS", (bounds_of,))
    certificate = bound(problem_of())
    assert certificate.widened is not None
    assert certificate.upper_bound == certificate.widened.upper_bound < 1.5
    assert certificate.method == "wider limits"
