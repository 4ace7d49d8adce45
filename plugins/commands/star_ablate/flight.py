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
from typing import Any, NamedTuple

from star_core import Mission, Registry, StarError

log = logging.getLogger(__name__)


class Job(NamedTuple):
    """A run for a worker: the mission with its seed, and where to record it, if at all."""

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
    """Fly jobs received over `connection` and send their results, until it is closed.

    The process becomes the leader of a process group, which can be killed with all processes that
    plugins started, and which does not receive keyboard interrupts. Its output goes to a file.
    """
    os.setsid()
    file = os.open(output, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    for stream in (1, 2):  # standard output and standard error
        os.dup2(file, stream)
    faulthandler.enable()
    logging.basicConfig(format=f"worker {os.getpid()}: %(message)s", stream=sys.stderr)
    registry = Registry()
    with suppress(EOFError, BrokenPipeError):  # the parent has closed the connection
        while True:
            connection.send(fly_job(connection.recv(), registry))


def fly_job(job: Job, registry: Registry) -> Result:
    """Fly a job, and return its result, also if it raises."""
    from star_core import fly

    begun = time.perf_counter()
    try:
        summary = fly(job.mission, registry, folder=job.folder)
    except StarError as error:
        return Result("failed", str(error), time.perf_counter() - begun, None)
    except (Exception, SystemExit) as error:
        log.exception("%s, seed %d, raised", job.mission.name, job.mission.scene.seed)
        reason = f"{type(error).__name__}: {error}"
        return Result("failed", reason, time.perf_counter() - begun, None)
    return Result(summary["outcome"], summary["reason"], time.perf_counter() - begun, summary)
