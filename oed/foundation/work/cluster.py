"""A running Dask cluster that does the work: its address, the connection to it, and whether it fits.

Start it with `dask scheduler` and, on each machine, `dask worker tcp://HOST:8786 --nworkers N --nthreads 1`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from oed.foundation.errors import Failure, UserMistake
from oed.foundation.extras import extra

CONNECTING = 5.0
"""Time [s] that the scheduler is given to answer, and its workers to be there."""
PACKAGES = ("oed", "casadi", "numpy", "scipy")
"""What results depend on: of the same version everywhere."""
_ADDRESS = re.compile(r"(tcp|tls)://[^\s:/]+:\d{1,5}|(tcp|tls)://\[[0-9a-fA-F:]+\]:\d{1,5}")


@dataclass(frozen=True)
class Cluster:
    """A running Dask cluster, given in place of a number of processes.

    Attributes:
        address: of its scheduler, e.g. "tcp://192.168.1.5:8786".

    Raises:
        UserMistake: not such an address.
    """

    address: str

    def __post_init__(self) -> None:
        """Check the address."""
        if not _ADDRESS.fullmatch(self.address):
            raise UserMistake(
                f"expected the address of a Dask scheduler, tcp://HOST:PORT, got {self.address!r}"
            )

    def connect(self) -> Connection:
        """The connection to it, made once in a process.

        Raises:
            UserMistake: the extra `cluster` is not installed.
            Failure: nobody answers, there are no workers, or they have other versions of what computes.
        """
        connection = _connection(self.address)
        if connection.client.status == "closed":
            _connection.cache_clear()
            connection = _connection(self.address)
        connection.check()
        return connection

    def executor(self) -> Any:
        """What takes tasks, as `concurrent.futures` has it; workers that join later are given some.

        Raises:
            UserMistake, Failure: as `connect` does.
        """
        return self.connect().client.get_executor(pure=False)

    def failure(self, error: Exception) -> Failure | None:
        """What it means that a task ended so; None for an error of the task's own."""
        from concurrent.futures import CancelledError

        from distributed.scheduler import KilledWorker

        if isinstance(error, KilledWorker):
            return Failure(
                f"workers of the cluster at {self.address} died again and again over the same task, perhaps "
                "for want of memory: give each more of it (--memory-limit of `dask worker`)"
            )
        if isinstance(error, CancelledError | OSError):
            return Failure(f"the cluster at {self.address} is gone: the work is not done")
        return None

    @property
    def size(self) -> int:
        """How many tasks it works on at a time: one in each of its processes."""
        return max(1, len(self.connect().workers()))


@dataclass
class Connection:
    """A client of a cluster's scheduler.

    Attributes:
        address: of the scheduler.
        client: the `distributed.Client`.
    """

    address: str
    client: Any
    _checked: set[str] = field(default_factory=set)

    def workers(self) -> Mapping[str, Any]:
        """The processes that work there now, by address, with their threads."""
        found: Mapping[str, Any] = self.client.ncores()
        return found

    def check(self) -> None:
        """Make sure that there are workers, and that those not seen before have what this process has."""
        try:
            if not self.workers():
                self.client.wait_for_workers(1, timeout=CONNECTING)
            fresh = sorted(set(self.workers()) - self._checked)
            odd = [text for package in PACKAGES for text in self._differing(package, fresh)] if fresh else []
        except OSError:
            # TimeoutError is one of them.
            raise Failure(self._empty()) from None
        if odd:
            raise Failure("; ".join(odd) + ": install the same versions on every machine of the cluster")
        self._checked.update(fresh)

    def _empty(self) -> str:
        return (
            f"the cluster at {self.address} has no workers, or they do not answer: start some with "
            f"`dask worker {self.address} --nthreads 1`"
        )

    def _differing(self, package: str, workers: list[str]) -> list[str]:
        # Loaded here, for every command loads this module and hardly one asks.
        from importlib.metadata import PackageNotFoundError, version

        here = version(package)
        found = self.client.run(version, package, workers=workers, on_error="return")
        texts = []
        for worker, there in sorted(found.items()):
            if isinstance(there, PackageNotFoundError):
                texts.append(f"{worker} has no {package}, here it is {here}")
            elif isinstance(there, OSError):
                raise there
            elif there != here:
                texts.append(f"{worker} has {package} {there}, here it is {here}")
        return texts


@cache
def _connection(address: str) -> Connection:
    distributed = extra("distributed", "cluster", "work on a Dask cluster")
    try:
        client = distributed.Client(address, timeout=CONNECTING, set_as_default=False, name="oed")
    except (OSError, ValueError) as error:
        raise Failure(f"no Dask scheduler answers at {address}: {str(error).partition(chr(10))[0]}") from None
    return Connection(address, client)
