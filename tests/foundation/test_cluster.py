"""Work on a Dask cluster: a real one, of two processes; the same results as here, whoever dies."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import dask
import distributed
import numpy as np
import pytest
from builders import problem_of, random_drive
from distributed.utils import get_mp_context
from studies import small, without_seconds, write_study
from worker_tasks import dying_once, refusing, slow

from oed.cli import main
from oed.foundation.errors import Failure, UserMistake
from oed.foundation.work import cluster
from oed.foundation.work.cluster import Connection
from oed.foundation.work.parallel import run_tasks
from oed.optimize import Cluster, Genetic, Ipopt, Solver, candidate_scores, solve
from oed.records.record import load_record
from oed.robots.sensors import Displacements
from oed.simulation import monte_carlo
from oed.workflow.sweep import parse_axis, sweep

PROBLEM = problem_of(samples=20, coefficients=6)
TINY = small(solvers="{kind: genetic, population: 20, generations: 3}").replace("samples: 40", "samples: 12")
LOADED = ["distributed", "oed.optimize", "oed.simulation.monte_carlo", "oed.workflow.sweep"]


@pytest.fixture(scope="module")
def local() -> Iterator[distributed.LocalCluster]:
    """Two processes of one thread, and their scheduler."""
    # Children of one process that has loaded all that they need: each would take a second of its own for it.
    method = {"distributed.worker.multiprocessing-method": "forkserver"}
    with dask.config.set(method):
        get_mp_context().set_forkserver_preload(LOADED)
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
        ) as started:
            yield started
            # Before its scheduler goes: a connection that is lost is complained of.
            cluster._connection(started.scheduler_address).client.close()
            cluster._connection.cache_clear()


@pytest.fixture(scope="module")
def workers(local: distributed.LocalCluster) -> Cluster:
    return Cluster(local.scheduler_address)


@pytest.fixture
def always_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Even work that is done sooner here goes to the workers."""
    monkeypatch.setattr("oed.optimize.search.POOL_SECONDS", 0.0)
    for name in ("WORTH", "WRITING"):
        monkeypatch.setattr(candidate_scores, name, 0.0)


@pytest.mark.slow
class TestRealCluster:
    @pytest.mark.parametrize(
        "search",
        [Ipopt(starts=3, perturbations=0, second_stage="none"), Genetic(population=12, generations=3)],
        ids=["ipopt", "ga"],
    )
    @pytest.mark.usefixtures("always_shared")
    def test_searches_find_the_same(self, workers: Cluster, search: Solver):
        here, there = (solve(PROBLEM, search, seed=4, workers=who) for who in (1, workers))
        np.testing.assert_array_equal(here.trajectory.coefficients, there.trajectory.coefficients)
        assert here.evaluation.objective == there.evaluation.objective
        assert [one.objective for one in here.starts] == [one.objective for one in there.starts]

    def test_simulated_experiments_are_the_same(self, workers: Cluster, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr(monte_carlo, "BATCH", 50)
        noisy = problem_of(samples=12, measurement=Displacements(segments=4, noise={"position": 0.01}))
        drive = random_drive(noisy, 1)
        here, there = (
            monte_carlo.validate(noisy, drive, replicates=120, seed=2, workers=who) for who in (1, workers)
        )
        np.testing.assert_array_equal(here.sampled, there.sampled)
        np.testing.assert_array_equal(here.mean, there.mean)
        assert here.checks == there.checks

    def test_an_interrupt_gives_up_the_rest(self, local: distributed.LocalCluster, workers: Cluster):
        def stop(index: int, result: int) -> None:
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            run_tasks(slow, list(range(40)), workers, stop)
        deadline = time.monotonic() + 3
        while local.scheduler.tasks and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not local.scheduler.tasks

    def test_what_a_task_raises_arrives(self, workers: Cluster):
        with pytest.raises(Failure, match=r"no [01]"):
            run_tasks(refusing, [0, 1], workers, lambda index, result: None)

    def test_a_sweep_is_the_same(self, workers: Cluster, tmp_path: Path):
        file = write_study(tmp_path, TINY)
        axes = [parse_axis("limits.wheel_speed=5,10 rad/s")]
        here, there = (
            without_seconds(sweep(file, axes, tmp_path / side, workers=who).data)
            for side, who in (("here", 1), ("there", workers))
        )
        assert here == there
        for row in here["points"]:
            one, other = (load_record(tmp_path / side / row["folder"]).best for side in ("here", "there"))
            assert one.drive == other.drive

    def test_from_the_command_line(
        self, workers: Cluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ):
        file = str(write_study(tmp_path, TINY))
        assert main(["solve", file, "--quiet", "--cluster", workers.address]) == 0
        there = capsys.readouterr().out.splitlines()
        assert main(["solve", file, "--quiet", "--workers", "1"]) == 0
        here = capsys.readouterr().out.splitlines()
        # All but the time, which comes last.
        assert [line.split()[:-1] for line in here] == [line.split()[:-1] for line in there]

    # The last one: who comes instead of the killed one has nothing more to load.
    def test_a_worker_killed_loses_nothing(self, workers: Cluster, tmp_path: Path):
        found: dict[int, int] = {}
        tasks = [(tmp_path / "died", number) for number in range(6)]
        run_tasks(dying_once, tasks, workers, found.__setitem__)
        # Had a task been done here, this process would be gone.
        assert found == {number: number**2 for number in range(6)}
        assert (tmp_path / "died").exists()


class TestAddress:
    @pytest.mark.parametrize("address", ["", "host:1", "tcp://:1", "tcp://host", "http://host:1"])
    def test_malformed(self, address: str):
        with pytest.raises(UserMistake, match="tcp://HOST:PORT"):
            Cluster(address)

    @pytest.mark.parametrize("address", ["tcp://10.0.0.1:8786", "tls://node-1.lab:8786", "tcp://[::1]:8786"])
    def test_sound(self, address: str):
        assert Cluster(address).address == address

    @pytest.mark.slow
    def test_nobody_answers(self, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr(cluster, "CONNECTING", 0.2)
        with pytest.raises(Failure, match=r"no Dask scheduler answers at tcp://127.0.0.1:9"):
            Cluster("tcp://127.0.0.1:9").connect()

    def test_the_extra_is_missing(self, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setitem(sys.modules, "distributed", None)
        with pytest.raises(UserMistake, match=r"pip install 'oed\[cluster\]'"):
            Cluster("tcp://127.0.0.1:8").connect()


class Workers:
    """Stands for a client of workers with other packages."""

    def __init__(self, there: dict[str, Any]) -> None:
        self.there, self.asked = there, 0

    def ncores(self) -> dict[str, int]:
        return {"tcp://worker:1": 1} if self.there else {}

    def wait_for_workers(self, count: int, timeout: float) -> None:
        raise TimeoutError

    def run(self, function: Any, package: str, workers: list[str], on_error: str) -> dict[str, Any]:
        self.asked += 1
        assert function is version
        return {worker: self.there.get(package, version(package)) for worker in workers}


class TestWorkersPackages:
    def test_other_versions_are_named(self):
        client = Workers({"oed": "0.0.7", "scipy": "1.0"})
        with pytest.raises(Failure) as caught:
            Connection("tcp://a:1", client).check()
        text = str(caught.value)
        assert f"tcp://worker:1 has oed 0.0.7, here it is {version('oed')}" in text
        assert "has scipy 1.0" in text
        assert "casadi" not in text
        assert "install the same versions" in text

    def test_missing_ones_are_named(self):
        with pytest.raises(Failure, match="tcp://worker:1 has no oed"):
            Connection("tcp://a:1", Workers({"oed": PackageNotFoundError("oed")})).check()

    def test_the_same_are_asked_once(self):
        client = Workers({"oed": version("oed")})
        connection = Connection("tcp://a:1", client)
        connection.check()
        asked = client.asked
        connection.check()
        assert 0 < asked == client.asked

    @pytest.mark.slow
    def test_no_workers(self):
        with pytest.raises(Failure, match=r"has no workers.*dask worker tcp://a:1 --nthreads 1"):
            Connection("tcp://a:1", Workers({})).check()
