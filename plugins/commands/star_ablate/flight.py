"""One run as its worker process flies it."""

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
"""What tells libraries how many threads to use. As many workers fly as there are cores, so that
more than one thread each would only get in each other's way."""


STREAMS: Final = (1, 2)  # standard output and standard error, as the system numbers them


@dataclass(frozen=True, slots=True)
class Task:
    """What a worker is to fly.

    Attributes:
        mission: With its seed.
        folder: Where to record; None keeps no record.
    """

    mission: Mission
    folder: Path | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a run.

    Attributes:
        outcome: Of the mission: ``completed``, ``failed`` or ``aborted``; ``failed`` also if it
            raised, and ``crashed`` if its process ended.
        reason: Why it did not complete.
        wall_time: How long it took, s; what Python compiles and the first run of a process imports
            included.
        summary: As ``summary.json`` has it; None of a run that raised or crashed.
    """

    outcome: str
    reason: str
    wall_time: float
    summary: Mapping[str, Any] | None


def serve(connection: Connection, output: Path) -> None:
    """Fly what comes over `connection` and answer with results, until it is closed.

    The process becomes the head of a group, which can be ended with all that plugins started in
    it, and which an interrupt from the keyboard does not reach.

    Args:
        connection: Takes a `Task` and gives a `Result`, in turn.
        output: The file to which the process and its plugins print.
    """
    os.setsid()
    file = os.open(output, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    for stream in STREAMS:
        os.dup2(file, stream)
    faulthandler.enable()
    logging.basicConfig(format=f"worker {os.getpid()}: %(message)s", stream=sys.stderr)
    registry = Registry()
    with suppress(EOFError, BrokenPipeError):  # nobody is at the other end any more
        while True:
            connection.send(flown(connection.recv(), registry))


def flown(task: Task, registry: Registry) -> Result:
    """Fly, and return what came of it, whatever that is."""
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
