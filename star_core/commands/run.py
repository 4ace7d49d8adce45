"""``star run``: flies a mission, shows its progress and prints its summary."""

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
from types import FrameType, MappingProxyType
from typing import Any

from star_core.commands.command_line import guarded
from star_core.commands.land_requests import listening
from star_core.commands.live_view import FlightProgress
from star_core.commands.main import FAILED
from star_core.commands.output import LatestRun, new_folder
from star_core.errors import InputError
from star_core.mission import Mission
from star_core.mission_file.mission_loader import load
from star_core.operator import Operator
from star_core.plugin_support.discovery import Source
from star_core.registry import Registry
from star_core.runner import fly, outcome_of
from star_core.toolkit.progress import Progress, log

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
        found = registry.find("run_option", name)
        observer = guarded("option", found, found.offer.make, mission, registry, *values)
        registry.add(observer, replace(found.source, plugin=f"{found.source.plugin}:{name}"))
    operator = operator or Operator()
    with _signals(operator), listening(operator, mission.name):
        summary = fly(mission, registry, folder=folder, save_frames=save_frames, operator=operator)
    status = FAILED if operator.lost else outcome_of(summary)
    lost = [f"not recorded: {text}" for text in operator.lost]
    if not as_json:
        return status, "\n".join([format_summary(summary, folder), *lost])
    for line in lost:
        log(f"star: {line}")
    return status, json.dumps(summary, indent=2)


def _expected_duration(mission: Mission, registry: Registry) -> float | None:
    """Return how long plugins expect the mission to take, s, if one of them knows."""
    try:
        found = registry.manager.hook.star_expected_duration(mission=mission, registry=registry)
        return None if found is None else float(found)
    except Exception:
        log_messages.debug("the duration of the mission cannot be estimated", exc_info=True)
        return None


def format_summary(summary: Mapping[str, Any], folder: Path | None) -> str:
    """Return a summary as text."""
    collisions = summary["collisions"]
    factor, apart = summary["realtime_factor"], summary["min_separation_m"]
    rmse, clear = summary["position_rmse_m"], summary["min_clearance_m"]
    flown = summary["path_length_m"]["total"]
    by = "" if summary["distances_from"] == "ground_truth" else " (estimated positions)"
    rows = [
        (
            "flight",
            f"{summary['flight_time_s']:.1f} s with {_many(summary['agents'])}"
            + (f", {factor:.{0 if factor >= 1 else 1}f} times real time" if factor else ""),
        ),
        ("slowest plugin", _slowest(summary)),
        *(("slow ticks", text) for text in _slow(summary["slow_ticks"])),
        (
            "collisions",
            f"{collisions['agent_agent']} between agents, "
            f"{collisions['agent_obstacle']} with obstacles{by}",
        ),
        ("closest approach", f"{apart:.2f} m{by}" if apart is not None else ""),
        ("corrected", _corrected(summary["corrected"])),
        ("late ticks", _late(summary["late_ticks"], summary["latest_tick_s"])),
        ("clearance", f"{clear:.2f} m at least{by}" if clear is not None else ""),
        ("position error", f"{rmse:.3f} m RMS" if rmse is not None else ""),
        ("targets", _targets(summary["targets"])),
        ("flown", f"{flown:.1f} m in all" if flown is not None else ""),
        ("record", str(folder) if folder and (folder / "summary.json").exists() else ""),
    ]
    head = f"{summary['mission']}: {summary['outcome']}"
    head += f": {summary['reason']}" if summary["reason"] else ""
    return "\n".join([head, *(f"  {label:<18}{text}" for label, text in rows if text)])


def _slowest(summary: Mapping[str, Any]) -> str:
    """Return the plugin that took most of a flight slower than real time, if there is one."""
    factor, wall_time = summary["realtime_factor"], summary["wall_time_s"]
    if factor is None or factor >= 1 or not summary["compute_s"]:
        return ""
    spent, plugin = max((spent, plugin) for plugin, spent in summary["compute_s"].items())
    return f"{plugin}, {spent:.1f} of {wall_time:.1f} s" if spent > wall_time / 2 else ""


def _slow(slow_ticks: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield every plugin that took too long for ticks of a simulation."""
    for plugin, slow in slow_ticks.items():
        yield f"{slow['ticks']} of {plugin}, the slowest took {slow['longest_s']:.1f} s"


def _corrected(corrected: Mapping[str, int]) -> str:
    """Return the numbers of corrected setpoints by reason, if there are any."""
    counts = [f"{count} for {why}" for why, count in corrected.items() if count]
    return f"setpoints: {', '.join(counts)}" if counts else ""


def _late(ticks: int, worst: float) -> str:
    """Return the number of late ticks, and the greatest lateness, s, if there are any."""
    return f"{ticks}, by {worst:.2f} s at most" if ticks else ""


def _targets(targets: Mapping[str, Any]) -> str:
    """Return the number of targets found, if there are any."""
    total = targets["total"]
    return f"{targets['found']} of {total} found" if total else ""


def _many(agents: Sequence[str]) -> str:
    return "1 agent" if len(agents) == 1 else f"{len(agents)} agents"


def _folder(out: str | None, name: str) -> Path:
    """Return the folder of a new record.

    Raises:
        InputError: It has a record already, or is not a folder.
    """
    if out is None:
        return new_folder(name)
    folder = Path(out)
    if not out or (folder.exists() and not folder.is_dir()):
        text = f"--out {out}: is a file; name a folder" if out else "--out: is empty"
        raise InputError(text, "invalid-argument")
    above = next(path for path in (folder, *folder.parents) if path.exists())
    if not (above.is_dir() and os.access(above, os.W_OK)):
        text = f"--out {out}: cannot be made: nothing can be written in '{above}'"
        raise InputError(text, "unwritable-file")
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
