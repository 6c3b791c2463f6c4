"""Limits at all times by rows of few instants: which are added, which give way, what holds in the end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import ACCELERATION, SPEED, problem_of, random_drive

from oed.kernel.criteria import E
from oed.kernel.dynamics.trajectory import Trajectory
from oed.kernel.evaluation import evaluate
from oed.kernel.problem import Problem
from oed.optimize import Ipopt, solve
from oed.optimize.exchange import ENOUGH, IDLE, Exchange
from oed.optimize.lower_level import Instants
from oed.optimize.terms import terms_of
from oed.optimize.transcription.coarse import SearchGrid
from oed.optimize.transcription.program import OUT_OF_TIME, SLOTS, IpoptOutcome
from oed.robots.limits import BodySpeed, Rectangle, YawRate
from oed.robots.sensors import Poses

HALF = 0.05
ROOM = Rectangle(x=(-HALF, HALF), y=(-HALF, HALF))
FINE = 50


@pytest.fixture(scope="module")
def problem() -> Problem:
    return problem_of(
        measurement=Poses(noise={"position": 0.01, "heading": 0.02}),
        limits=(SPEED, ROOM, BodySpeed(bounds=0.3), ACCELERATION, YawRate(bounds=2)),
        criterion=E(),
    )


@pytest.fixture(scope="module")
def exchange(problem: Problem) -> Exchange:
    return Exchange(problem, terms_of(problem))


def fast(problem: Problem) -> Trajectory:
    """A drive that leaves the room and is too fast at times."""
    drive = random_drive(problem, 4)
    return replace(drive, coefficients=2 * drive.coefficients)


def all_rows(problem: Problem, drive: Trajectory, times: np.ndarray) -> np.ndarray:
    """By how much x, y, speed and yaw rate are beyond their bounds, as shares of these, (rows, times)."""
    radius, track = (getattr(problem.model, name) for name in ("wheel_radius", "track"))
    period, (x, y, heading) = drive.period, drive.start
    found, sample = [], 0
    for time in times:
        while time > period * (sample + 1) + 1e-12:
            x, y, heading = rolled((x, y, heading), drive.inputs[sample], period, radius, track)
            sample += 1
        at = rolled((x, y, heading), drive.inputs[sample], time - period * sample, radius, track)
        right, left = drive.inputs_at(np.array([time]))[0]
        forward, turning = radius * (right + left) / 2, radius * (right - left) / track
        found.append([at[0] / HALF, at[1] / HALF, forward / 0.3, turning / 2])
    return np.abs(found).reshape(-1, 4).T - 1


def rolled(
    pose: tuple[float, ...], inputs: np.ndarray, elapsed: float, radius: float, track: float
) -> tuple[float, ...]:
    """A pose after an arc of a circle."""
    x, y, heading = pose
    forward, turned = radius * inputs.sum() / 2 * elapsed, radius * (inputs[0] - inputs[1]) / track * elapsed
    chord, middle = forward * np.sinc(turned / (2 * np.pi)), heading + turned / 2
    return x + chord * np.cos(middle), y + chord * np.sin(middle), heading + turned


@pytest.mark.slow
def test_what_is_exceeded_is_the_worst_of_every_stretch(problem: Problem, exchange: Exchange):
    drive = fast(problem)
    found = exchange.lower_level.peaks(drive, ENOUGH, FINE)
    steps = FINE * drive.samples
    times = drive.duration * np.arange(1, steps + 1) / steps
    rows = all_rows(problem, drive, times)
    assert (rows > 0).any(axis=1).sum() >= 3
    for row, course in enumerate(rows):
        own = found.time[found.row == row]
        before, after = np.r_[-9, course[:-1]], np.r_[course[1:], -9]
        high = np.flatnonzero((course > ENOUGH) & (course >= before) & (course > after))
        np.testing.assert_allclose(np.sort(own), times[high], atol=drive.period / FINE)
        np.testing.assert_allclose(
            exchange.lower_level.violations(found.some(found.row == row), drive)[np.argsort(own)],
            all_rows(problem, drive, np.sort(own))[row],
            atol=1e-9,
        )


def test_the_vertex_between_the_times_looked_at_is_found(problem: Problem, exchange: Exchange):
    drive = fast(problem)
    coarse, fine = (exchange.lower_level.peaks(drive, 0.05, times) for times in (10, 1000))
    inside = coarse.some((coarse.row < 2) & (coarse.time < drive.duration))
    assert len(inside)
    for row, time in zip(inside.row, inside.time, strict=True):
        assert np.abs(fine.time[fine.row == row] - time).min() < drive.period / 100


def test_those_that_a_drive_stays_away_from_give_way(problem: Problem, exchange: Exchange):
    begun, drive = exchange.first_instants(), fast(problem)
    room = -len(begun) % SLOTS
    times = np.linspace(0.01, 0.99, room + 5) * drive.duration
    more = Instants(np.zeros(len(times), dtype=int), np.zeros(len(times), dtype=int), times)
    found = exchange.with_more(begun, more, drive)
    assert len(found) == len(begun) + room
    assert set(times) <= set(found.time[found.row == 0])
    given_way = ~begun.near(found, 1e-12)
    assert given_way.sum() == 5
    excess = exchange.lower_level.violations(begun, drive)
    assert excess[given_way].max() <= min(excess[~given_way].min(), -IDLE)
    # Where there is room, all stay.
    assert len(exchange.with_more(begun, more.some(times < times[room]), drive)) == len(begun) + room


def test_nothing_gives_way_to_what_is_as_close(problem: Problem, exchange: Exchange):
    drive = fast(problem)
    close = exchange.lower_level.peaks(drive, -IDLE / 2, FINE)
    several = Instants(*(np.tile(one, SLOTS) for one in (close.row, close.run, close.time)))
    assert len(exchange.with_more(several, close, drive)) == len(several) + len(close)


def test_on_fewer_samples_bounds_are_moved_by_what_rows_differ(problem: Problem):
    grid = SearchGrid(problem, samples=problem.design.samples // 2)
    assert grid.coarse
    exchange, drive = Exchange(problem, grid.design.terms), fast(problem)
    own = Exchange(grid.design.problem, grid.design.terms)
    instants = exchange.first_instants()
    chosen, unmoved = (one.chosen_rows(instants, drive) for one in (exchange, own))
    coarse = replace(drive, samples=grid.design.problem.design.samples)
    apart = own.lower_level.at(coarse, instants) - exchange.lower_level.at(drive, instants)
    assert np.abs(apart).max() > 1e-3
    np.testing.assert_allclose(chosen.upper - unmoved.upper, apart, atol=1e-12)
    np.testing.assert_allclose(chosen.lower - unmoved.lower, apart, atol=1e-12)


def passes(problem: Problem, exchange: Exchange, **given) -> tuple[list[bool], IpoptOutcome]:
    """Which solves are loose where limits stay exceeded, and what is handed on."""
    loose: list[bool] = []

    def solve(begin, after, chosen, loosely: bool) -> IpoptOutcome:
        loose.append(loosely)
        return IpoptOutcome(
            begin, np.zeros(0), "Solve_Succeeded", 1, 1, np.zeros(0), np.zeros(0), 1.0, np.zeros(0)
        )

    drive = fast(problem)
    outcome, _ = exchange.solve(solve, np.zeros(4), None, exchange.first_instants(), lambda _: drive, **given)
    return loose, outcome


def test_what_is_handed_on_is_never_solved_loosely(problem: Problem, exchange: Exchange, monkeypatch):
    for most in (1, 3):
        monkeypatch.setattr("oed.optimize.exchange.EXCHANGES", most)
        loose, outcome = passes(problem, exchange)
        assert loose == [True] * (most - 1) + [False]
        assert outcome.succeeded


def test_exchanges_end_when_the_time_is_up_and_say_so(problem: Problem, exchange: Exchange):
    loose, outcome = passes(problem, exchange, until=-np.inf)
    assert len(loose) == 1
    assert outcome.return_status == OUT_OF_TIME
    assert not outcome.succeeded


@pytest.mark.slow
def test_in_the_end_limits_hold_at_all_times(problem: Problem):
    problem = replace(problem, design=problem_of(samples=10, coefficients=6).design)
    searched = Ipopt(starts=1, perturbations=0, second_stage="shortest_path")
    found = solve(problem, searched, seed=1, workers=1)
    drive = found.trajectory
    margins = {one.name: one for one in evaluate(problem, drive).margins}
    assert all(one.margin >= -2 * ENOUGH * one.size for one in margins.values())
    steps = 100 * drive.samples
    rows = all_rows(problem, drive, drive.duration * np.arange(1, steps + 1) / steps)
    assert -ENOUGH < rows.max() < 2 * ENOUGH
