"""Flies runs on a running Dask cluster, to which it attaches as a client."""

from __future__ import annotations

import importlib
import json
import logging
import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final

from star_ablate import remote
from star_ablate.basis import Basis
from star_ablate.flight import DIFFERS, Job, Result
from star_ablate.orders import order_of
from star_core import InputError, Registry, StarError
from star_core.toolkit import log

CONNECT_TIMEOUT: Final = 10.0  # s
CLOSE_TIMEOUT: Final = 2.0  # s
POLL_INTERVAL: Final = 0.2  # s, between checks for an interrupt
REFRESH_PERIOD: Final = 1.0  # s, between updates of the list of workers
REMEDY: Final = "install the same version of star-swarm[cluster] on every machine"
QUEUED: Final = 2  # runs for each thread of a worker: one waits while the other is flown


class Cluster:
    """Flies runs on the workers of a Dask cluster.

    Runs are texts, flown by a function of an installed module. Dask decides where, and flies those
    of a worker that dies elsewhere. A worker on which STAR cannot be imported, or with other code,
    is named and gets no further runs.

    Args:
        registry: Of the plugins.
        address: Of the scheduler; None to read it from `file`.
        file: Scheduler file.
        task: Flies a run, as `remote.fly`; a function of a module that the workers can import.

    Attributes:
        size: Number of runs at a time, of all workers.

    Raises:
        InputError: Dask is not installed, or the scheduler cannot be reached.
    """

    def __init__(
        self,
        registry: Registry,
        address: str | None,
        file: str | None = None,
        task: Callable[[str], str] = remote.fly,
    ) -> None:
        try:
            import distributed
        except ImportError:
            needs = "--scheduler needs the package 'distributed': pip install 'star-swarm[cluster]'"
            raise InputError(needs, "missing-package") from None
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors are raised here
        if file is not None and not Path(file).is_file():
            raise InputError(f"--scheduler-file {file}: there is no such file", "file-not-found")
        self._basis = Basis(registry)
        self._task = task
        self.name = address or f"of {file}"
        connect: Any = distributed.Client  # which has no types
        try:
            self._client = connect(
                address, scheduler_file=file, timeout=CONNECT_TIMEOUT, set_as_default=False
            )
        except (OSError, ValueError, TypeError) as error:
            wrong = f"scheduler {self.name}: cannot be reached: {str(error) or 'no answer'}"
            raise InputError(wrong, "unreachable-scheduler") from error
        self._threads: dict[str, int] = {}  # by the addresses of workers
        self._imports: dict[str, Any] = {}  # by address: futures that import STAR there
        self._ready: set[str] = set()  # addresses of workers on which that succeeded
        self._different: set[str] = set()  # addresses of workers
        self._refreshed = -REFRESH_PERIOD
        self._refresh()
        self.size = max(1, sum(self._threads.values()))
        if not self._threads:
            log(f"star: scheduler {self.name} has no workers yet")

    def fly_all(
        self,
        jobs: Sequence[Job],
        output: Path,
        time_limit: float | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> Generator[tuple[int, Result]]:
        executor = self._client.get_executor(pure=False)
        waiting = deque(range(len(jobs)))
        flying: dict[Future[str], tuple[int, list[str]]] = {}  # with the addresses it may go to
        finished: SimpleQueue[Future[str]] = SimpleQueue()
        try:
            while waiting or flying:
                if stopped():
                    return
                self._refresh()
                if self._client.status != "running":
                    raise self._lost()
                for future, (index, addresses) in list(flying.items()):
                    if self._threads.keys().isdisjoint(addresses):  # all of them are lost
                        del flying[future]
                        future.cancel()
                        waiting.appendleft(index)
                while waiting and len(flying) < QUEUED * self._capacity():
                    index = waiting.popleft()
                    files = self._basis.files(jobs[index].mission)
                    order = order_of(jobs[index], files, time_limit).text()
                    addresses = self._usable()
                    future = executor.submit(self._task, order, workers=addresses)
                    flying[future] = index, addresses
                    future.add_done_callback(finished.put)
                with suppress(Empty):
                    future = finished.get(timeout=POLL_INTERVAL)
                    if future not in flying:  # cancelled
                        continue
                    index, _ = flying.pop(future)
                    if (result := self._result(future)) is None:
                        waiting.appendleft(index)
                    else:
                        yield index, result
        finally:
            executor.shutdown(wait=False)

    def close(self) -> None:
        with suppress(TimeoutError, OSError):
            self._client.close(timeout=CLOSE_TIMEOUT)

    def _result(self, future: Future[str]) -> Result | None:
        """Return the result of a run; None if it is to be flown elsewhere.

        Raises:
            StarError: The connection to the scheduler is lost.
        """
        import distributed

        if future.cancelled():
            raise self._lost()
        error = future.exception()
        if isinstance(error, distributed.KilledWorker):
            self._exclude(error.last_worker.address, "it died with a run")
            return None
        if error is not None:
            raise StarError(f"scheduler {self.name}: a run raised {error!r}", "different-worker")
        address, content = json.loads(future.result())
        result = Result(*content)
        if result.outcome != DIFFERS:
            return result
        self._exclude(address, f"it differs in {result.reason}")
        return None

    def _lost(self) -> StarError:
        return StarError(f"scheduler {self.name}: the connection is lost", "unreachable-scheduler")

    def _exclude(self, address: str, why: str) -> None:
        """Give a worker no further runs.

        Raises:
            StarError: There is no other.
        """
        if address not in self._different:
            self._different.add(address)
            log(f"star: worker {address} is left out: {why}")
        self._refreshed = -REFRESH_PERIOD
        self._refresh()
        if self._threads and self._threads.keys() <= self._different:
            wrong = f"scheduler {self.name}: no worker can fly these runs; the last one: {why}"
            raise StarError(wrong, "different-worker")

    def _refresh(self) -> None:
        """Update the list of workers, at most once per `REFRESH_PERIOD`, and those that are ready.

        Raises:
            StarError: STAR cannot be imported on any worker.
        """
        if time.monotonic() - self._refreshed >= REFRESH_PERIOD:
            self._refreshed = time.monotonic()
            workers = self._client.scheduler_info(n_workers=-1)["workers"]
            if self._threads and not workers:
                log(f"star: scheduler {self.name} has lost all workers; runs wait for others")
            self._threads = {address: worker["nthreads"] for address, worker in workers.items()}
            for address in self._threads.keys() - self._imports.keys():
                self._imports[address] = self._client.submit(
                    importlib.import_module, self._task.__module__, workers=[address], pure=False
                )
        for address in self._threads.keys() - self._ready - self._different:
            imported = self._imports[address]
            if imported.status == "finished":
                self._ready.add(address)
            elif imported.status == "error":
                error = imported.exception()
                self._exclude(address, f"STAR cannot be imported there: {error}; {REMEDY}")

    def _usable(self) -> list[str]:
        """Return the addresses of the workers that runs may go to.

        Dask ends a worker that receives a function of a module that it cannot import.
        """
        return [a for a in self._threads if a in self._ready and a not in self._different]

    def _capacity(self) -> int:
        return sum(self._threads[address] for address in self._usable())
