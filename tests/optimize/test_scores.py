"""What ranks candidates: the same to the last bit, whoever computes it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import ACCELERATION, BOX, SPEED, problem_of
from written_out import WrittenOut

import oed
from oed.foundation.arrays import Array
from oed.kernel.dynamics.compiled import at_work, compiler
from oed.kernel.dynamics.space import Spline
from oed.optimize.terms import terms_of
from oed.optimize.terms.terms import Terms
from oed.robots.limits import (
    BodySpeed,
    CommandedSpeed,
    CommandedYawRate,
    EndHeading,
    LateralAcceleration,
    PathLength,
    WheelSpeed,
)
from oed.robots.limits.workspace import CircularObstacle, Obstacles
from oed.robots.sensors import Displacements, Poses, RelativePoses
from oed.robots.space import DesignSpace
from oed.uncertainty.robust import Robust
from oed.uncertainty.uncertainty import Uncertainty

SPACE: dict[str, Any] = {"duration": 6, "samples": 8, "spline": Spline(coefficients=6)}
NOISE = {"position": 0.01, "heading": 0.02}
POSES = Poses(noise=NOISE)
LAGGING = oed.Unicycle(lag_v=0.15, lag_omega=0.25, body_radius=0.2)
PROBLEMS: dict[str, dict[str, Any]] = {
    "noise that grows": {**SPACE, "measurement": RelativePoses(noise={**NOISE, "position_per_speed": 0.05})},
    "limits": {
        "design": DesignSpace(**SPACE, runs=2, start="free", rest_to_rest=False),
        "measurement": POSES,
        "limits": (
            WheelSpeed(bounds=(2, 10)),
            ACCELERATION,
            BodySpeed(bounds=0.4),
            BOX,
            Obstacles(shapes=(CircularObstacle(kind="circle", x=0.5, y=0.5, radius=0.2),)),
            EndHeading(at="start"),
            PathLength(bounds=0.3),
        ),
    },
    "limits on instants": {
        "design": DesignSpace(**SPACE, runs=2, start="free"),
        "measurement": Displacements(segments=4),
        "limits": (
            SPEED,
            BOX,
            BodySpeed(bounds=(-0.3, 0.4)),
            Obstacles(shapes=(CircularObstacle(kind="circle", x=0.5, y=0.5, radius=0.2),)),
            ACCELERATION,
        ),
    },
    "a motion that lags": {
        **SPACE,
        "model": LAGGING,
        "measurement": POSES,
        "limits": (
            CommandedSpeed(bounds=0.5),
            CommandedYawRate(bounds=1.5),
            BodySpeed(bounds=0.4),
            LateralAcceleration(bounds=0.2),
        ),
    },
    "robust": {
        **SPACE,
        "measurement": Displacements(segments=4),
        "limits": (SPEED, BOX),
        "uncertainty": Uncertainty(within={"track": 0.05}),
        "robust": Robust(),
    },
}
each = pytest.mark.parametrize("name", PROBLEMS)
needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler on this machine")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "oed"


def candidates(terms: Terms) -> Array:
    # Many: what rounds otherwise shows in one number of some thousand.
    rng = np.random.default_rng(4)
    return rng.uniform(-1, 1, (1000, terms.size)) * rng.uniform(0.1, 1.5, (1000, 1))


@lru_cache
def built(name: str) -> Terms:
    return terms_of(problem_of(**PROBLEMS[name]), refine=2)


@lru_cache
def scored(name: str) -> tuple[Array, Array]:
    terms = built(name)
    return terms.scored(candidates(terms))


def assert_same_bits(found: Sequence[Array], expected: Sequence[Array]) -> None:
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
@each
def test_neither_company_nor_threads_change_a_bit(name: str):
    terms = built(name)
    drives = candidates(terms)
    assert_same_bits(terms.scored(drives, threads=2), scored(name))
    for place in range(0, 1000, 77):
        alone = terms.scored(drives[place : place + 1])
        assert_same_bits(alone, [part[place : place + 1] for part in scored(name)])


@needs_compiler
@pytest.mark.slow
@each
def test_nor_does_generated_c(name: str, cache: Path, monkeypatch: pytest.MonkeyPatch):
    terms = terms_of(problem_of(**PROBLEMS[name], name=name), refine=2)
    drives = candidates(terms)
    monkeypatch.setattr("oed.kernel.dynamics.direct_call.PAYS", 0.0)
    terms.scored(drives)
    while at_work():
        time.sleep(0.05)
    terms.scored(drives)
    assert list(cache.glob("*.so"))
    assert_same_bits(terms.scored(drives), scored(name))


@each
@pytest.mark.slow
def test_limits_are_exceeded_as_by_their_rows(name: str):
    terms, whole = built(name), WrittenOut(problem_of(**PROBLEMS[name]), 2)
    entries, excess = scored(name)
    expected_entries, expected = whole.scored(candidates(terms))
    np.testing.assert_allclose(entries, expected_entries, rtol=1e-9, atol=1e-9 * np.abs(entries).max())
    np.testing.assert_allclose(excess, expected, rtol=1e-9, atol=1e-9)
    assert (excess > 0).any(axis=0).all()
    assert (excess < 0).any()
