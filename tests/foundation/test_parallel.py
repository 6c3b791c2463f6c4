"""Independent tasks over processes: none is lost, none is done twice, whoever dies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import problem_of
from studies import small, without_seconds, write_study
from worker_tasks import dying_once

from oed.foundation.errors import Failure
from oed.foundation.work import parallel
from oed.foundation.work.parallel import BREAKDOWNS, run_tasks
from oed.optimize import candidate_scores
from oed.optimize.candidate_scores import CandidateScorer
from oed.optimize.transcription.design import DesignExpressions
from oed.optimize.transcription.starting_points import random_drives
from oed.records.record import load_record
from oed.workflow.sweep import parse_axis, sweep


def done_by(function: Any, tasks: list[Any], workers: Any) -> dict[int, Any]:
    """Results by index; no task may be answered twice."""
    found: dict[int, Any] = {}

    def take(index: int, result: Any) -> None:
        assert index not in found
        found[index] = result

    run_tasks(function, tasks, workers, take)
    return found


@pytest.mark.slow
def test_a_worker_killed_loses_nothing(tmp_path: Path):
    tasks = [(tmp_path / "died", number) for number in range(4)]
    assert done_by(dying_once, tasks, 2) == {number: number**2 for number in range(4)}
    assert (tmp_path / "died").exists()


@pytest.mark.skipif(os.name != "posix", reason="signals are POSIX's")
@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_workers_end_with_their_parent_and_say_nothing(tmp_path: Path, number: int):
    program = (
        "import signal, sys, pathlib, time; from oed.foundation.work.signals import ending_alike\n"
        "from oed.foundation.work.parallel import run_tasks\n"
        "from worker_tasks import sleeping, with_a_slow_feeder\n"
        "with_a_slow_feeder()\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "try:\n"
        "    with ending_alike():\n"
        "        run_tasks(sleeping, [pathlib.Path(sys.argv[1])] * 4, 2, print)\n"
        "except KeyboardInterrupt:\n"
        "    time.sleep(0.2)\n"
        "    sys.exit(7)\n"
    )
    paths = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path)],
        env={**os.environ, "PYTHONPATH": paths},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    give_up = time.monotonic() + 60
    while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < give_up:
        time.sleep(0.05)
    pids = [int(path.name) for path in tmp_path.iterdir()]
    assert len(pids) == 2
    # A terminal sends Ctrl-C to all of them.
    send = os.killpg if number == signal.SIGINT else os.kill
    send(process.pid, number)
    _, err = process.communicate(timeout=10)
    if number != signal.SIGKILL:
        assert (process.returncode, err) == (7, "")
    give_up = time.monotonic() + 5
    while any(map(alive, pids)) and time.monotonic() < give_up:
        time.sleep(0.05)
    assert not any(map(alive, pids))


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    # Whom nobody has waited for yet has ended all the same.
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.slow
def test_a_sweep_over_processes_is_the_same(tmp_path: Path):
    file = write_study(tmp_path, small(solvers="{kind: genetic, population: 20, generations: 3}"))
    axes = [parse_axis("limits.wheel_speed=5,10 rad/s")]
    one, two = (sweep(file, axes, tmp_path / str(count), workers=count).data for count in (1, 2))
    assert without_seconds(one) == without_seconds(two)
    for row in one["points"]:
        records = (load_record(tmp_path / side / row["folder"]).data for side in ("1", "2"))
        first, second = (without_seconds(record) for record in records)
        assert first == second


def breaking(done_before_each: int) -> tuple[Any, list[list[int]]]:
    """Stands for a pool that does so many tasks and then breaks; and what it was given each time."""
    given: list[list[int]] = []

    @contextmanager
    def outputs(function: Any, tasks: dict[int, Any], workers: Any) -> Iterator[Any]:
        given.append(list(tasks))

        def results() -> Iterator[tuple[int, Any]]:
            for index in list(tasks)[:done_before_each]:
                yield index, function(tasks[index])
            if len(given[-1]) > done_before_each:
                raise BrokenProcessPool

        yield results()

    return outputs, given


def test_only_what_has_no_result_yet_is_done_again(monkeypatch: pytest.MonkeyPatch):
    outputs, given = breaking(1)
    monkeypatch.setattr(parallel, "_outputs", outputs)
    count = BREAKDOWNS + 3
    assert done_by(str, list(range(count)), 2) == {index: str(index) for index in range(count)}
    assert given == [list(range(first, count)) for first in range(count)]


def test_workers_that_die_before_anything_is_done_are_given_up(monkeypatch: pytest.MonkeyPatch):
    outputs, given = breaking(0)
    monkeypatch.setattr(parallel, "_outputs", outputs)
    with pytest.raises(Failure, match=r"memory.*--workers"):
        done_by(str, [1, 2], 2)
    assert len(given) == BREAKDOWNS


class Overlap:
    """A task that notes how many of it run at the same time."""

    def __init__(self) -> None:
        self.running, self.most = 0, 0

    def __call__(self, task: float) -> float:
        self.running += 1
        self.most = max(self.most, self.running)
        time.sleep(task)
        self.running -= 1
        return task


def test_threads_of_one_process_take_turns_and_leave_signals_alone():
    before, overlap, found = signal.getsignal(signal.SIGINT), Overlap(), []

    def work() -> None:
        found.append(parallel._Job(overlap, 7, 0.02)())

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [(7, 0.02)] * 3
    assert overlap.most == 1
    assert signal.getsignal(signal.SIGINT) is before


def test_a_population_scores_the_same_in_parts(monkeypatch: pytest.MonkeyPatch):
    counts = []

    def counting(function: Any, tasks: list[Any], workers: Any, take: Any) -> None:
        counts.append(len(tasks))
        run_tasks(function, tasks, 1, take)

    monkeypatch.setattr(candidate_scores, "run_tasks", counting)
    for name in ("WORTH", "WRITING"):
        monkeypatch.setattr(candidate_scores, name, 0.0)
    problem = problem_of()
    design = DesignExpressions(problem, refine=2)
    candidates = random_drives(design, np.linspace(0.1, 1, 11), np.random.default_rng(0))
    scored = CandidateScorer(design, 2, 3, expected=30)
    for _ in range(2):
        values, excess = scored.score(candidates)
        expected = design.score_many(candidates)
        np.testing.assert_array_equal(values, expected[0])
        np.testing.assert_array_equal(excess, expected[1])
    # The first time here, which also tells how long it takes.
    assert counts == [3]


def test_a_population_is_scored_here_where_writing_its_drive_out_elsewhere_takes_longer(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(candidate_scores, "run_tasks", None)
    monkeypatch.setattr(candidate_scores, "WORTH", 0.0)
    monkeypatch.setattr(candidate_scores, "WRITING", 1.0)
    design = DesignExpressions(problem_of(), refine=2)
    candidates = random_drives(design, np.full(5, 0.5), np.random.default_rng(0))
    scored = CandidateScorer(design, 2, 2, expected=1000)
    for _ in range(2):
        assert scored.score(candidates)[0].shape == (5,)


def test_a_quick_population_is_scored_here(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(candidate_scores, "run_tasks", None)
    design = DesignExpressions(problem_of(), refine=2)
    candidates = random_drives(design, np.full(5, 0.5), np.random.default_rng(0))
    scored = CandidateScorer(design, 2, 2)
    for _ in range(2):
        assert scored.score(candidates)[0].shape == (5,)
