"""Flies a mission for ``star run``: progress, signals, the folder of the record."""

from __future__ import annotations

import json
import logging
import os
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from tempfile import TemporaryFile
from types import FrameType, MappingProxyType

from star_basics.land_requests import listening
from star_basics.latest_run import LatestRun
from star_basics.live_view import FlightProgress
from star_basics.summary_text import format_summary
from star_core import InputError, Mission, Operator, Registry, fly, load
from star_core.commands import Source, guarded, new_folder
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
    for warning in mission.warnings:
        log(warning)
    folder = _folder(out, mission.name) if keep else None
    progress = FlightProgress(partial(_expected_duration, mission, registry), events=not as_json)
    registry.add(progress, Source("star-swarm:progress"))
    if keep and out is None:
        registry.add(LatestRun(), Source("star-swarm:latest"))
    for name, values in observers.items():
        option = registry.find("run_option", name)
        observer = guarded("option", option, option.offer.make, mission, registry, *values)
        registry.add(observer, replace(option.source, plugin=f"{option.source.plugin}:{name}"))
    operator = operator or Operator()
    with _signals(operator), listening(operator, mission.name):
        summary = fly(mission, registry, folder=folder, save_frames=save_frames, operator=operator)
    status = int(bool(operator.lost) or summary["outcome"] != "completed")
    lost = [f"not recorded: {text}" for text in operator.lost]
    if not as_json:
        return status, "\n".join([format_summary(summary, folder), *lost])
    for line in lost:
        log(f"star: {line}")
    return status, json.dumps(summary, indent=2)


def _expected_duration(mission: Mission, registry: Registry) -> float | None:
    """Return how long plugins expect the mission to take, s, if one of them knows."""
    try:
        rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
    except Exception:
        log_messages.debug("the duration of the mission cannot be estimated", exc_info=True)
        return None
    return None if rehearsal is None else rehearsal.duration


def _folder(out: str | None, name: str) -> Path:
    """Return the folder of a new record.

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
    return folder


@contextmanager
def _signals(operator: Operator) -> Iterator[None]:
    """Land at Ctrl-C, SIGTERM and SIGHUP instead of being ended by them; then stop the motors."""
    numbers = count(1)

    def handle(number: int, _frame: FrameType | None) -> None:
        match next(numbers):
            case 1:
                operator.land_all()
                what = "landing; again stops the motors"
            case 2:
                operator.stop_motors()
                what = "stopping the motors; again interrupts a plugin that hangs"
            case _ if operator.recording:
                what = "the flight has ended; its record is being completed"
            case _:  # a plugin hangs
                raise KeyboardInterrupt
        text = f"star: {signal.Signals(number).name}: {what}\n"
        with suppress(OSError):  # the terminal may be gone
            try:
                sys.stderr.write(text)
            except RuntimeError:  # the signal interrupts another write
                os.write(sys.stderr.fileno(), text.encode())

    caught = {signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", signal.SIGTERM)}
    before = {number: signal.signal(number, handle) for number in caught}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
