"""Flies a mission for ``star run``: progress, signals, the folder of the record."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from types import MappingProxyType

from star_basics.land_requests import listening
from star_basics.latest_run import LatestRun
from star_basics.live_view import FlightProgress
from star_basics.summary_text import format_summary
from star_core import InputError, Mission, Operator, PluginError, Registry, fly, load
from star_core.commands import Source, guarded, land_on_signals, new_folder, reserving
from star_core.toolkit import Progress, log

log_messages = logging.getLogger(__name__)


class _Stderr(logging.Handler):
    """Writes log messages above the progress of the flight."""

    def emit(self, record: logging.LogRecord) -> None:
        log(self.format(record))


def log_to_stderr(*, verbose: bool) -> None:
    """Write log messages to standard error; with `verbose` also the tracebacks of plugins."""
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.WARNING,
        format="star: %(message)s",
        handlers=[_Stderr()],
    )
    logging.getLogger("numba").setLevel(logging.WARNING)
    logging.getLogger("transitions").setLevel(logging.ERROR)  # a trigger may have no transition


def run_mission(  # noqa: PLR0913 -- options of the command
    path: str,
    assignments: Sequence[str],
    registry: Registry,
    *,
    out: str | None,
    keep: bool,
    save_frames: bool,
    observers: Mapping[str, Sequence[str]] = MappingProxyType({}),
    as_json: bool,
    operator: Operator | None = None,
) -> tuple[int, str]:
    """Fly the mission at `path` and show its progress; return exit status and text to print.

    `observers` has the run options that were given, with their values. The caller awaits the
    landings of `operator`, if there are any after the flight.

    Raises:
        InputError: The mission cannot be flown, or there is a record at `out` already.
        PluginError: A plugin cannot be made, or the links cannot be opened.
    """
    with Progress(f"loading {path}"):
        mission = load(Path(path), registry, assignments)
    for warning in (*mission.warnings, *_check(mission, registry)):
        log(warning)
    progress = FlightProgress(partial(_expected_duration, mission, registry), events=not as_json)
    registry.add(progress, Source("star-swarm:progress"))
    if keep and out is None:
        registry.add(LatestRun(), Source("star-swarm:latest"))
    for name, values in observers.items():
        option = registry.find("run_option", name)
        observer = guarded("option", option, option.offer.make, mission, registry, *values)
        registry.add(observer, replace(option.source, plugin=f"{option.source.plugin}:{name}"))
    operator = operator or Operator()
    record = _folder(out, mission.name) if keep else nullcontext()
    with record as folder, land_on_signals(operator), listening(operator, mission.name):
        summary = fly(mission, registry, folder=folder, save_frames=save_frames, operator=operator)
    status = int(bool(operator.lost) or summary["outcome"] != "completed")
    lost = [f"not recorded: {text}" for text in operator.lost]
    if not as_json:
        return status, "\n".join([format_summary(summary, folder), *lost])
    for line in lost:
        log(f"star: {line}")
    return status, json.dumps(summary, indent=2)


def _check(mission: Mission, registry: Registry) -> list[str]:
    """Return what ``star check`` refuses in a rehearsal, as warnings: simulated drones fly it.

    A plugin whose check fails is named in one.

    Raises:
        InputError: There is such a problem, and the drones are real.
    """
    try:
        with Progress("checking"):
            listed = registry.manager.hook.star_check(mission=mission, registry=registry)
    except PluginError as error:
        return [f"the flight goes without the checks of the rehearsal: {error}"]
    errors = [problem for problems in listed for problem in problems if not problem.warning]
    if errors and mission.scene.realtime:
        raise InputError(mission.file.located(errors))
    return mission.file.located(problem._replace(warning=True) for problem in errors)


def _expected_duration(mission: Mission, registry: Registry) -> float | None:
    """Return how long plugins expect the mission to take, s, if one of them knows."""
    try:
        rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
    except Exception:
        log_messages.debug("the duration of the mission cannot be estimated", exc_info=True)
        return None
    return None if rehearsal is None else rehearsal.duration


@contextmanager
def _folder(out: str | None, name: str) -> Iterator[Path]:
    """Yield the folder of a new record.

    Raises:
        InputError: It has a record already, is not a folder, or nothing can be written there.
    """
    folder = new_folder(name) if out is None else Path(out)
    label = f"--out {out}" if out is not None else f"record {folder}"
    if out == "" or (folder.exists() and not folder.is_dir()):
        text = f"--out {out}: is a file; name a folder" if out else "--out: is empty"
        raise InputError(text, "invalid-argument")
    above = next(path for path in (folder, *folder.parents) if path.exists())
    try:
        with TemporaryFile(dir=above):
            pass
    except OSError as error:
        hint = "" if out is not None else "; name another folder by --out, or fly with --no-record"
        why = f"nothing can be written in '{above}' ({error.strerror}){hint}"
        raise InputError(f"{label}: cannot be made: {why}", "unwritable-file") from None
    if (folder / "manifest.json").exists():
        text = f"--out {out}: holds the record of a run already; name another folder"
        raise InputError(text, "unwritable-file")
    with reserving(name) if out is None else nullcontext(folder) as record:
        yield record
