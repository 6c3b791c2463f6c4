"""Settings of property tests, and solutions that several tests look at."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
from collections.abc import Iterator
from typing import Any

# Tests run on all processors already; threads of the linear algebra would only be in each other's way.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Compiled once and kept, whatever the environment says: the test modules with their rewritten assertions,
# and the package for the hundreds of processes that tests start.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Reading thousands of tests makes objects but no garbage: looking for it takes a third of that time.
gc.disable()

from oed.foundation.work import parallel

if "PYTEST_XDIST_WORKER" in os.environ:
    # Before any other module takes it: processes of each process of the tests would wait for each other's
    # processors, and load the package anew. What many workers do, tests ask for by their number.
    parallel.default_workers = lambda: 1

import pytest
from builders import forget_problems, make_flagship
from hypothesis import settings

from oed.kernel.problem import Problem
from oed.kernel.solution import Solution
from oed.optimize import Ipopt, solve
from oed.robots.sensors import Displacements
from oed.robots.space import DesignSpace

settings.register_profile("seeded", derandomize=True, deadline=None, max_examples=12)
settings.register_profile("quick", settings.get_profile("seeded"), max_examples=6)


def pytest_configure(config: pytest.Config) -> None:
    """Fewer examples of each property where slow tests are left out."""
    settings.load_profile("quick" if config.option.markexpr == "not slow" else "seeded")


LONGEST = (
    "test_real_logs.py",
    "test_docs.py",
    "test_drift.py",
    "test_sensors.py",
    "test_baselines_of_robots.py",
    "test_architecture.py",
    "test_starter.py",
    "test_campaign.py",
)
"""Files of more than 10 s of processor time beside those of the solvers, from the longest one down."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first: begun last, they would be waited for by all other processors."""
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.name, len(places)))


def pytest_collection_finish() -> None:
    """From here on there is garbage; the tests themselves are none. Looked for thirty times less often than
    usual, it takes a fifteenth less of all time.
    """
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)
    gc.enable()


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C answered as at a prompt, even where the tests run in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True)
def own_problems(request: pytest.FixtureRequest) -> Iterator[None]:
    """Where a test changes the package, problems of other tests are not its own, nor its own theirs."""
    if "monkeypatch" not in request.fixturenames:
        yield
        return
    forget_problems()
    yield
    forget_problems()


@pytest.fixture(scope="module")
def drawn_once() -> Iterator[None]:
    """Figures of pages that tests of a file have alike, to the last number, are drawn once."""
    from oed.report import page

    draw, kept = page._svg, dict[bytes, str]()

    def drawn(figure: Any) -> str:
        key = pickle.dumps(figure)
        if key not in kept:
            kept[key] = draw(figure)
        return kept[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "_svg", drawn)
        # What other processes draw, those that files before this one have left waiting, is not kept here.
        patch.setattr(page, "waiting", lambda: 1)
        yield


@pytest.fixture
def blank_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages with all their figures, which are empty: drawing them takes longer than all else."""

    def empty(sections: list[Any]) -> dict[str, str]:
        return {picture.name: "<svg/>" for section in sections for picture in section.pictures}

    monkeypatch.setattr("oed.report.page._drawings", empty)


@pytest.fixture
def few_screened(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches from the best of forty random drives, not of two thousand: of systems whose steps take long
    these are half of a search.
    """
    for module in ("search", "transcription.starting_points"):
        monkeypatch.setattr(f"oed.optimize.{module}.SCREENED", 40)


@pytest.fixture(scope="session")
def flagship() -> Problem:
    return make_flagship()


@pytest.fixture(scope="session")
def flagship_solution(flagship: Problem) -> Solution:
    """Five starts, nothing else."""
    options = Ipopt(starts=5, perturbations=0, second_stage="none")
    return solve(flagship, options, seed=0, workers=1)


@pytest.fixture(scope="session")
def three_segments() -> Problem:
    # A third of the usual samples, in segments of equal length: searched by pieces, in a tenth of the time.
    return make_flagship(design=DesignSpace(duration=20, samples=60), measurement=Displacements(segments=3))


@pytest.fixture(scope="session")
def three_segment_solution(three_segments: Problem) -> Solution:
    """The segment number of the paper's table."""
    return solve(three_segments, Ipopt(starts=1, perturbations=0), seed=0, workers=1)
