"""A tracker that loses the robot for moments, whose wheels are logged throughout."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from simulated import (
    ROBOT,
    TRUTH,
    Course,
    course,
    exchanged,
    fit_of,
    log_of,
    logged_problem,
    options,
    truth_of,
    with_losses,
)
from windowed import drifting

from oed.estimation import calibrate
from oed.estimation.preprocessing.moves import Moves, clock_offsets
from oed.estimation.preprocessing.wiring_checks import wiring_fault
from oed.logs.log import Log

RATE = 170
"""Of the tracker [Hz]."""
NOISE = (0.001, 0.003)
DRIFT = (0.004, 0.004, 0.02)
TRUE = truth_of(ROBOT, **TRUTH)


@cache
def drive(seed: int, seconds: float = 8.0) -> Course:
    return course(seconds=seconds, times=np.arange(round(seconds * RATE) + 1) / RATE, seed=seed)


def drives(of: Callable[[int], Course], seeds: range) -> list[Log]:
    return [log_of(of(seed), noise=NOISE, seed=seed, name=f"drive {seed}") for seed in seeds]


@pytest.mark.slow
def test_hardly_change_the_estimate():
    (log,) = drives(drive, range(1))
    lost = with_losses(log)
    assert len(lost.poses) < 0.8 * len(log.poses)
    # Bursts that the median step would take for gaps.
    assert np.count_nonzero(np.diff(lost.pose_times) > 5 / RATE) > 10
    whole, found = fit_of([log]), fit_of([lost])
    assert found.layout.count == 1
    sizes = np.sqrt(np.diag(whole.inverse))
    assert np.all(np.abs(found.values - whole.values) < sizes)
    assert np.all(np.sqrt(np.diag(found.inverse)) < 1.25 * sizes)


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 0.31])
def test_hide_neither_clocks_nor_crossed_wires(offset: float):
    log = with_losses(log_of(drive(1), noise=NOISE, offset=offset))
    assert clock_offsets(Moves.of(ROBOT, [log])) == pytest.approx([offset], abs=0.08)
    assert wiring_fault(Moves.of(ROBOT, [with_losses(log_of(drive(1), noise=NOISE))])) is None
    crossed = exchanged(with_losses(log_of(drive(1), noise=NOISE)))
    assert "are exchanged" in wiring_fault(Moves.of(ROBOT, [crossed]))


@pytest.mark.slow
def test_do_not_hide_drift():
    logs = drives(lambda seed: drifting(drive(seed), TRUE, DRIFT, seed), range(1))
    found = calibrate(
        logged_problem(),
        [with_losses(log, number) for number, log in enumerate(logs)],
        options(sensor_place=(), clock_offset=False),
    )
    assert found.segmenting.drifts
    off = np.abs(found.values - TRUE) / np.array([*found.standard_deviations.values()])
    assert np.all(off < found.covariances[0].half_width)
