"""One run, as flown by a worker process."""

from __future__ import annotations

import faulthandler
import json
import logging
import os
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

from star_ablate.basis import differences
from star_ablate.measures import selected
from star_ablate.orders import Order, basis_of, mission_of
from star_core import Mission, Registry, StarError
from star_core.toolkit import shortlist

DIFFERS: Final = "differs"  # outcome of a run that would depend on something else than planned

log = logging.getLogger(__name__)


class Job(NamedTuple):
    """A run for a worker.

    Attributes:
        mission: With its seed.
        folder: For its record; None if it is not recorded.
        assignments: Of the study's levels, by which `mission` was loaded.
        basis: What the result depends on, as `star_ablate.basis.Basis.of` returns it.
    """

    mission: Mission
    folder: Path | None = None
    assignments: Sequence[str] = ()
    basis: Mapping[str, str] | None = None


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

    def only(self, measures: Iterable[str]) -> Result:
        """Return the result with some measures of its summary."""
        summary = None if self.summary is None else selected(self.summary, measures)
        return replace(self, summary=summary)


def serve(descriptor: int, output: str) -> None:
    """Fly jobs and orders received over a connection and send their results, until it is closed.

    Args:
        descriptor: File descriptor of the connection.
        output: File to which the output of the process is appended; empty to keep it as it is.
    """
    connection = Connection(descriptor)
    if output:
        file = os.open(output, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
        for stream in (1, 2):  # standard output and standard error
            os.dup2(file, stream)
    faulthandler.enable()
    logging.basicConfig(format=f"worker {os.getpid()}: %(message)s", stream=sys.stderr)
    registry = Registry()
    with suppress(EOFError, BrokenPipeError):  # the parent has closed the connection
        while True:
            item = connection.recv()
            fly_item = fly_job if isinstance(item, Job) else fly_order
            connection.send(fly_item(item, registry))


def fly_job(job: Job, registry: Registry) -> Result:
    """Fly a job, and return its result, also if it raises.

    The outcome is `DIFFERS`, and nothing is flown, if code or a file has changed since the study
    was planned.
    """
    from star_core import fly

    if job.basis is not None and (
        changed := differences(job.basis, basis_of(job.mission, registry))
    ):
        return Result(DIFFERS, shortlist(changed), 0.0, None)
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


def fly_order(order: Order, registry: Registry) -> Result:
    """Fly an order of another machine, and return its result as if it had been flown there.

    The outcome is `DIFFERS`, and nothing is flown, if the result would depend on other code.
    """
    with TemporaryDirectory(prefix="star-run-") as folder:
        try:
            mission, different = mission_of(order, Path(folder), registry)
        except StarError as error:
            return Result(DIFFERS, error.message, 0.0, None)
        if different:
            return Result(DIFFERS, shortlist(different), 0.0, None)
        result = fly_job(Job(mission), registry)
        text = json.dumps([result.reason, result.summary])
        reason, summary = json.loads(text.replace(f"{folder}/", json.dumps(order.prefix)[1:-1]))
        return replace(result, reason=reason, summary=summary)
