"""Bounds of a robot whose yaw rate lags and whose track changes: what is proved of it, and what is not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from builders import RADIUS, TRACK, problem_of
from test_soundness import check

from oed.bounds import NOTHING, bound
from oed.bounds.reach import coefficient_rows, largest_input_gain, scales_lengths, top_speeds
from oed.kernel.criteria import E
from oed.kernel.problem import Problem
from oed.robots.limits import Rectangle, WheelAcceleration, WheelSpeed
from oed.robots.models import DifferentialDrive, SkidSteerSlip
from oed.robots.sensors import Poses
from oed.robots.sensors.poses import AbsoluteNoise
from oed.robots.space import DesignSpace

SIZES = {"wheel_radius": RADIUS, "track": TRACK}
EFFECTS = {"yaw_lag": 0.4, "track_per_yaw_rate": 0.01, "track_per_curvature": 0.05, "x_icr": -0.02}
LENGTHS = ("wheel_radius_right", "wheel_radius_left", "track")
CORNER = "every position in a corner of the room"


def slip_problem(estimate: tuple[str, ...] | None = None, **effects: Any) -> Problem:
    return problem_of(
        model=SkidSteerSlip(**SIZES, **effects),
        design=DesignSpace(duration=5, samples=24, rest_to_rest=False),
        limits=(WheelSpeed(bounds=10), WheelAcceleration(bounds=20), Rectangle(x=(-1, 1), y=(-1, 1))),
        measurement=Poses(noise=AbsoluteNoise(position=0.01, heading=0.02)),
        criterion=E(),
        estimate=estimate,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "effects",
    # What changes the track is bounded alike.
    [EFFECTS, *({name: EFFECTS[name]} for name in ("yaw_lag", "track_per_curvature", "x_icr")), {}],
    ids=["all", "yaw_lag", "track_per_curvature", "x_icr", "none"],
)
def test_no_drive_beats_the_bound(effects: dict[str, float]):
    problem = slip_problem(**effects)
    certificate = bound(problem, nodes=1)
    assert any(CORNER in one.method for one in certificate.bounds)
    # How fast it may be is known of the differential drive alone.
    assert len(certificate.bounds) == (2 if not effects else 1)
    assert check(problem, np.random.default_rng(1), 15, 10) > 10


@pytest.mark.parametrize("effects", [EFFECTS, {"track_per_curvature": 0.05}], ids=["all", "curvature"])
def test_what_was_proved_of_three_lengths_is_not_claimed_of_more(effects: dict[str, float]):
    problem = slip_problem(LENGTHS, **effects)
    certificate = bound(problem)
    assert (certificate.upper_bound, certificate.method, certificate.bounds) == (np.inf, NOTHING, ())
    assert top_speeds(problem) is None


def test_a_lag_keeps_the_lengths_in_proportion_and_has_no_top_speed():
    problem = slip_problem(yaw_lag=0.4)
    assert scales_lengths(problem, LENGTHS)
    assert not scales_lengths(problem, LENGTHS[:2])
    assert (largest_input_gain(problem), coefficient_rows(problem), top_speeds(problem)) == (None, None, None)


@pytest.mark.slow
def test_no_effects_leave_the_differential_drives_bounds():
    slip, plain = slip_problem(), slip_problem()
    plain = problem_of(**{**vars_of(plain), "model": DifferentialDrive(**SIZES)})
    found, expected = (bound(one, nodes=4) for one in (slip, plain))
    assert [(one.method, one.value) for one in found.bounds] == [
        (one.method, pytest.approx(one.value)) for one in expected.bounds
    ]


def vars_of(problem: Problem) -> dict[str, Any]:
    """What a problem is made of."""
    return {name: getattr(problem, name) for name in problem.__dataclass_fields__}
