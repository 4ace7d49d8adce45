"""Flies runs in parallel, in several independent processes of this machine.

`concurrent.futures.ProcessPoolExecutor` is not used: when one of its processes dies it aborts all
pending runs, and does not report which one caused it or how it died.
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from multiprocessing import connection
from pathlib import Path
from typing import Final, Protocol

from star_ablate.flight import DIFFERS, Job, Result
from star_ablate.orders import Order
from star_core import StarError

POLL_INTERVAL: Final = 0.2  # s, between checks whether to stop
EXIT_TIMEOUT: Final = 5.0  # s, in which a process ends by itself
ONE_THREAD: Final = dict.fromkeys(  # there are as many workers as cores
    ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1"
)
SERVE: Final = """\
import sys
sys.path[:] = sys.argv[3:]
from star_ablate.flight import serve
serve(int(sys.argv[1]), sys.argv[2])
"""
KILL_AT_EOF: Final = "read line; kill -9 -$0 $0"
"""Script that kills a process and its group, its argument, when the writer of its input has ended,
whatever ended it, and whatever that process computes."""


class Engine(Protocol):
    """Flies runs, on this machine (`Processes`) or on others.

    Attributes:
        size: Number of flights at a time.
    """

    size: int

    def fly_all(
        self,
        jobs: Sequence[Job],
        output: Path,
        time_limit: float | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> Generator[tuple[int, Result]]:
        """Yield the index and result of every job, in order of completion.

        Args:
            jobs: Runs to fly.
            output: File for the output of processes on this machine.
            time_limit: Wall time limit of a run, s.
            stopped: Polled; whether to skip the remaining jobs.

        Raises:
            StarError: Runs cannot be flown any more.
        """

    def close(self) -> None:
        """Release what the engine holds."""


class Processes:
    """Flies runs in processes of this machine.

    All of them have ended when the iterator of `fly_all` is exhausted or closed.

    Args:
        size: Number of processes.
    """

    def __init__(self, size: int) -> None:
        self.size = size

    def fly_all(
        self,
        jobs: Sequence[Job],
        output: Path,
        time_limit: float | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> Generator[tuple[int, Result]]:
        waiting = iter(enumerate(jobs))
        pool = [Worker(output) for _ in range(min(self.size, len(jobs)))]
        try:
            for worker in pool:
                worker.begin(*next(waiting), time_limit)
            while busy := {worker.connection: worker for worker in pool if worker.busy}:
                if stopped():
                    return
                soonest = min(POLL_INTERVAL, *(worker.remaining() for worker in busy.values()))
                ready = connection.wait(list(busy), soonest)
                for worker in busy.values():
                    if worker.connection not in ready and worker.remaining() > 0:
                        continue
                    done = worker.finish()
                    if done[1].outcome == DIFFERS:
                        wrong = f"changed since the study began: {done[1].reason}; run it again"
                        raise StarError(wrong, "different-worker")
                    if (following := next(waiting, None)) is not None:
                        worker.begin(*following, time_limit)
                    yield done
        finally:
            for worker in pool:
                worker.end()

    def close(self) -> None:
        pass


class Worker:
    """A process that flies one job after the other; it is replaced when it dies.

    It ends with this process, whatever ends this one.

    Args:
        output: File for its output; None for that of this process.

    Attributes:
        connection: Readable when a job is done or the process has ended.
        busy: Whether a job is running.
    """

    def __init__(self, output: Path | None) -> None:
        self._output = "" if output is None else str(output)
        self._limit = math.inf
        self._index = 0
        self._begun = 0.0
        self.busy = False
        self._process: subprocess.Popen[bytes] | None = None
        self._guard: subprocess.Popen[bytes] | None = None

    def begin(self, index: int, job: Job | Order, time_limit: float | None = None) -> None:
        """Start a job, with a limit of its wall time, s."""
        self._limit = math.inf if time_limit is None else time_limit
        if self._process is None:
            self._start()
        try:
            self.connection.send(job)
        except OSError:  # it died after the previous job; this job did not cause it
            self._kill()
            self._start()
            self.connection.send(job)
        self._index, self._begun, self.busy = index, time.monotonic(), True

    def finish(self) -> tuple[int, Result]:
        """Return the index of the job and its result.

        Call it when `connection` is readable or the time is up; in that case the process is killed.
        """
        self.busy = False
        if self.remaining() <= 0 and not self.connection.poll():
            return self._index, self._crashed(f"took longer than {self._limit:g} s")
        try:
            result: Result = self.connection.recv()
        except (EOFError, OSError):
            self._wait()
            result = self._crashed("its process ended with {}")
        return self._index, result

    def remaining(self) -> float:
        """Remaining time of the job, s."""
        return max(0.0, self._begun + self._limit - time.monotonic())

    def end(self) -> None:
        """End the process: immediately if it is busy, otherwise gracefully."""
        if self._process is None:
            return
        if not self.busy:
            self.connection.close()
            self._wait()
        self._kill()

    def _start(self) -> None:
        self.connection, theirs = connection.Pipe()
        number = theirs.fileno()
        for name, value in ONE_THREAD.items():  # libraries read it when they are loaded
            os.environ.setdefault(name, value)
        self._process = subprocess.Popen(  # noqa: S603 -- this very interpreter
            [sys.executable, "-c", SERVE, str(number), self._output, *sys.path],
            stdin=subprocess.DEVNULL,
            pass_fds=[number],
            start_new_session=True,  # a process group, with what plugins start; no Ctrl-C
        )
        theirs.close()  # so that this end reads EOF when the process ends
        self._guard = subprocess.Popen(  # noqa: S603 -- its argument is a number
            ["/bin/sh", "-c", KILL_AT_EOF, str(self._process.pid)],
            stdin=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def _wait(self) -> None:
        """Wait until the process has ended by itself, but not for long."""
        with suppress(subprocess.TimeoutExpired):
            if self._process is not None:
                self._process.wait(EXIT_TIMEOUT)

    def _crashed(self, why: str) -> Result:
        wall_time = time.monotonic() - self._begun
        status = self._kill()
        how = signal.Signals(-status).name if status < 0 else f"exit status {status}"
        return Result("crashed", why.format(how), wall_time, None)

    def _kill(self) -> int:
        """Kill the process and all its children; return its exit status."""
        process, self._process = self._process, None
        if process is None:
            return 0
        with suppress(ProcessLookupError, PermissionError):  # none of the group is left
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        if self._guard is not None:
            self._guard.kill()
            self._guard.communicate()
        self.connection.close()
        return process.returncode
