"""One run, as flown by a worker process."""

from __future__ import annotations

import faulthandler
import logging
import os
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from star_core import Mission, Registry, StarError

log = logging.getLogger(__name__)

THREADS: Final = (
    "NUMBA_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)
"""Thread limits of libraries. There are as many workers as cores, so more than one thread each
would slow them down."""


STREAMS: Final = (1, 2)  # standard output and standard error, as the system numbers them


@dataclass(frozen=True, slots=True)
class Task:
    """A run for a worker.

    Attributes:
        mission: The mission, with its seed.
        folder: Where to record; None keeps no record.
    """

    mission: Mission
    folder: Path | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """Result of a run.

    Attributes:
        outcome: Outcome of the mission: ``completed``, ``failed`` or ``aborted``; ``failed`` also
            if it raised, and ``crashed`` if its process ended.
        reason: Why it did not complete.
        wall_time: Wall time, s, including compilation and the imports of a process's first run.
        summary: Content of ``summary.json``; None if the run raised or crashed.
    """

    outcome: str
    reason: str
    wall_time: float
    summary: Mapping[str, Any] | None


def serve(connection: Connection, output: Path) -> None:
    """Fly tasks received over `connection` and send their results, until it is closed.

    The process becomes the leader of a process group, which can be killed with all processes that
    plugins started, and which does not receive keyboard interrupts.

    Args:
        connection: Receives a `Task` and sends a `Result`, in turn.
        output: File for the output of the process and its plugins.
    """
    os.setsid()
    file = os.open(output, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    for stream in STREAMS:
        os.dup2(file, stream)
    faulthandler.enable()
    logging.basicConfig(format=f"worker {os.getpid()}: %(message)s", stream=sys.stderr)
    registry = Registry()
    with suppress(EOFError, BrokenPipeError):  # the parent has closed the connection
        while True:
            connection.send(flown(connection.recv(), registry))


def flown(task: Task, registry: Registry) -> Result:
    """Fly a task, and return its result, also if it raises."""
    from star_core import fly

    begun = time.perf_counter()
    try:
        summary = fly(task.mission, registry, folder=task.folder)
    except StarError as error:
        return Result("failed", str(error), time.perf_counter() - begun, None)
    except (Exception, SystemExit) as error:
        log.exception("%s, seed %d, raised", task.mission.name, task.mission.scene.seed)
        reason = f"{type(error).__name__}: {error}"
        return Result("failed", reason, time.perf_counter() - begun, None)
    return Result(summary["outcome"], summary["reason"], time.perf_counter() - begun, summary)
