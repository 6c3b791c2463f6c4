"""Joblib's tasks on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from uuid import uuid4

from joblib.parallel import ParallelBackendBase

from oed.foundation.errors import Failure
from oed.foundation.work.cluster import Connection


class ClusterBackend(ParallelBackendBase):  # type: ignore[misc]
    """Joblib's way to a cluster: its own Dask backend waits for ever for tasks whose workers keep dying,
    leaves unfinished ones behind, and puts large arguments on a single worker, with which they are lost.
    """

    supports_retrieve_callback = True

    def __init__(self, connection: Connection) -> None:
        """Send tasks over a connection."""
        super().__init__()
        self._connection = connection
        self._futures: list[Any] = []

    def effective_n_jobs(self, n_jobs: int) -> int:
        """At least 2: joblib would do the work of one worker here."""
        return max(2, n_jobs)

    def submit(self, func: Callable[[], Any], callback: Callable[[Any], None]) -> Any:
        """Send a task; `callback` is told its future when it has ended, in whatever way."""
        future = self._connection.client.submit(func, key=f"oed-{uuid4().hex}")
        self._futures.append(future)
        future.add_done_callback(callback)
        return future

    def retrieve_result_callback(self, out: Any) -> Any:
        """The result of a future that has ended; raises what the task raised.

        Raises:
            Failure: its workers kept dying, or the cluster is gone.
        """
        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker

        try:
            return out.result()
        except KilledWorker:
            raise Failure(self._killed()) from None
        except (FutureCancelledError, OSError):
            raise Failure(
                f"the cluster at {self._connection.address} is gone: the work is not done"
            ) from None

    def stop_call(self) -> None:
        """Let the scheduler forget what has ended."""
        for future in self._futures:
            future.release()
        self._futures.clear()

    def abort_everything(self, ensure_ready: bool = True) -> None:
        """Give up what has not ended."""
        del ensure_ready
        self._connection.client.cancel(self._futures, force=True)

    def _killed(self) -> str:
        return (
            f"workers of the cluster at {self._connection.address} died again and again over the same task, "
            "perhaps for want of memory: give each more of it (--memory-limit of `dask worker`)"
        )
