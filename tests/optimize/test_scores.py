"""What ranks candidates: the same to the last bit, whoever computes it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from builders import ACCELERATION, BOX, SPEED, problem_of

import oed
import oed.optimize.terms.pieces
from oed.foundation.arrays import Array
from oed.kernel.dynamics.compiled import compiled, compiler
from oed.kernel.dynamics.space import Spline
from oed.kernel.problem import Problem
from oed.optimize.terms import terms_of
from oed.optimize.terms.base import COMPILING, Terms
from oed.optimize.terms.pieces import Pieces
from oed.optimize.terms.row_bounds import RowBounds, excess
from oed.optimize.terms.unrolled import Unrolled
from oed.optimize.transcription.design import LOOKING, DesignExpressions
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
    return rng.uniform(-1, 1, (terms.size, 1000)) * rng.uniform(0.1, 1.5, 1000)


def scored(function: ca.Function, terms: Terms) -> list[Array]:
    drives = candidates(terms)
    return [np.array(one) for one in function.map(drives.shape[1])(drives)]


@lru_cache
def built(name: str) -> Terms:
    return terms_of(problem_of(**PROBLEMS[name]), refine=2)


@lru_cache
def written_out(name: str) -> list[Array]:
    return scored(built(name).scores_written_out, built(name))


def assert_same_bits(found: list[Array], expected: list[Array]) -> None:
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
@each
def test_written_out_they_are_the_same_bits(name: str):
    terms = built(name)
    assert isinstance(terms, Unrolled if "robust" in PROBLEMS[name] else Pieces)
    assert_same_bits(written_out(name), scored(terms.scores, terms))


@pytest.mark.slow
def test_simplified_they_would_not_be():
    # What the test before looks at is looked at closely enough.
    terms = built("limits")
    found, expected = (scored(one, terms)[0] for one in (terms.scores.expand(), terms.scores))
    assert (found != expected).any()
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())


@needs_compiler
@pytest.mark.slow
@each
def test_so_they_are_in_generated_c(name: str, cache: Path):
    terms = built(name)
    function = compiled(terms.scores)
    assert len(list(cache.iterdir())) == 1
    assert_same_bits(scored(function, terms), written_out(name))


@each
@pytest.mark.slow
def test_limits_are_exceeded_as_by_their_rows(name: str):
    terms, whole = built(name), Unrolled(problem_of(**PROBLEMS[name]), 2)
    entries, excess = written_out(name)
    function = ca.Function(
        "rows", [whole.unknowns], [whole.entries, *(one.expression for one in whole.limits)]
    )
    values, *limits = scored(function, terms)
    np.testing.assert_allclose(entries, values, rtol=1e-9, atol=1e-9 * np.abs(entries).max())
    for rows, own, found in zip(whole.limits, limits, excess, strict=True):
        beyond = np.maximum(own - rows.upper[:, None], rows.lower[:, None] - own)
        expected = beyond.max(axis=0) / rows.size
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    assert (excess > 0).any(axis=1).all()
    assert (excess < 0).any()


def test_long_drives_are_not_written_out(monkeypatch: pytest.MonkeyPatch):
    problem = problem_of(**SPACE, measurement=POSES, limits=(SPEED,))
    terms = terms_of(problem, refine=2)
    assert isinstance(terms, Pieces)
    monkeypatch.setattr(oed.optimize.terms.pieces, "LONG", terms.operations - 1)
    assert terms.scores_written_out is terms.scores


def test_simplification_is_left_as_it_was():
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    terms_of(problem_of(**SPACE, limits=(SPEED, BOX)), refine=2).scores_written_out  # noqa: B018
    assert ca.GlobalOptions.getSimplificationOnTheFly() == before


@needs_compiler
@pytest.mark.slow
def test_compiled_anew_only_where_that_spares_time(cache: Path):
    def design() -> DesignExpressions:
        return DesignExpressions(problem, 2)

    def libraries() -> int:
        return len(list(cache.iterdir())) if cache.exists() else 0

    problem: Problem = problem_of(**SPACE, limits=(SPEED, BOX))
    drives = candidates(design().terms).T
    plain = design().score_many(drives)
    # Per operation: less than finding out takes, enough to compile, and enough to find that.
    for spared, count in ((0.5 * LOOKING, 0), (30 * COMPILING, 1), (1.5 * LOOKING, 1)):
        own = design()
        assert (own.compile_scores(spared * own.terms.written) is None) == (count == 0)
        assert libraries() == count
        assert_same_bits(list(own.score_many(drives)), list(plain))
        assert own._scores.is_a("External") == bool(count)
    unknown = design()
    assert unknown.compile_scores(0.5 * LOOKING * unknown.terms.written) is None


@pytest.mark.parametrize(
    ("lower", "upper"),
    [
        ((-1.0, -1.0), (1.0, 1.0)),
        ((-2.0, 0.5), (0.0, 3.0)),
        ((-np.inf, -2.0, 0.5), (1.0, np.inf, 2.0)),
        ((-np.inf, -np.inf), (0.5, 1.5)),
        ((0.5, 1.5), (np.inf, np.inf)),
    ],
    ids=str,
)
def test_a_limit_is_exceeded_by_the_most_that_any_row_is(lower, upper):
    low, high, size = np.array(lower), np.array(upper), 0.25
    values = ca.SX.sym("values", len(low))
    found = ca.Function("f", [values], [excess(values, RowBounds(low, high, size, "m"))])
    for one in np.random.default_rng(0).normal(scale=2, size=(50, len(low))):
        assert float(found(one)) == pytest.approx(np.maximum(one - high, low - one).max() / size)
