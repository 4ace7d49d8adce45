"""Reads the folder of a recorded flight."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tokenize import TokenError
from typing import Any, Final

import numpy as np

from star_core.errors import ContractError, InputError
from star_core.formats import format_function
from star_core.messages.arrays import Array
from star_core.messages.telemetry import Detections
from star_core.plugin_support.registry import Registry
from star_core.records import record_files, run_html, unfinished
from star_core.records.planned_paths import PlannedPaths
from star_core.records.record_files import (
    MANIFEST,
    SUMMARY,
    check_arrays,
    check_json,
    check_rows,
    read_arrays,
    read_json,
)
from star_core.world.scene import Agent
from star_core.world.world import World

OPTIONAL: Final = ("timing", "paths")
"""Tables that a complete record may lack."""

DAMAGE: Final = (
    *(OSError, ValueError, TypeError, LookupError, AttributeError, ContractError),
    *(zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, MemoryError),
    *(SyntaxError, TokenError),  # of the header of an array
)
"""What the readers of JSON, ZIP and NumPy files, and what takes their content apart, raise for a
damaged file."""

TIMING_KEYS: Final = (
    *("wall_time_s", "realtime_factor", "compute_us", "compute_s"),
    *("late_ticks", "latest_tick_s", "slow_ticks"),
)
"""Keys of a summary that depend on the computer and its load."""

TIMING_EVENTS: Final = frozenset({"late", "slow"})
"""Kinds of events that do."""


def split_timing(summary: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a summary without what depends on the wall clock, and that.

    The first is the content of ``summary.json``, which is the same for every simulated flight of a
    mission with a seed, and the second that of ``timing.json``. The JSON of `fly` and of
    ``--json`` has both.

    Args:
        summary: Of a flight.

    Example:
        >>> split_timing({"seed": 1, "wall_time_s": 2.5, "events": [{"kind": "slow"}]})
        ({'seed': 1, 'events': []}, {'wall_time_s': 2.5, 'events': [{'kind': 'slow'}]})
    """
    events: dict[bool, list[Any]] = {False: [], True: []}
    for event in summary.get("events", ()):
        events[event["kind"] in TIMING_EVENTS].append(event)
    kept = {key: value for key, value in summary.items() if key not in TIMING_KEYS}
    timing = {key: summary[key] for key in TIMING_KEYS if key in summary}
    return kept | {"events": events[False]}, timing | {"events": events[True]}


def _with_timing(summary: dict[str, Any], timing: dict[str, Any]) -> dict[str, Any]:
    """Return the summary of which `split_timing` made two."""
    events = sorted([*summary["events"], *timing["events"]], key=lambda event: event["time"])
    return summary | timing | {"events": events}


@dataclass(frozen=True, repr=False)
class Run:
    """A recorded flight; `docs/record.md` describes its files.

    Attributes:
        folder: Where it is.
        manifest: The mission and world as flown, plugins, seed, packages.
        summary: Outcome, figures, steps and events, with the content of ``timing.json``.
        arrays: The arrays of ``trajectory.npz`` by name, over ticks and agents, map frame, SI.
        detections: All tags detected in images.
        paths: Planned paths.
        timing: The arrays of ``timing.npz`` by name, over ticks, s; empty without that file.
        agents: Name of the agent in each row.
        swarm: The agents with their starts and cameras, as the mission has them.
        world: Geofence, obstacles, landmarks and targets.
    """

    folder: Path
    manifest: Mapping[str, Any]
    summary: Mapping[str, Any]
    arrays: Mapping[str, Array]
    detections: Detections
    paths: PlannedPaths
    timing: Mapping[str, Array]
    agents: tuple[str, ...]
    swarm: tuple[Agent, ...]
    world: World

    def images(self, agent: str) -> dict[int, Path]:
        """Return the saved images of an agent by their times, ms."""
        return record_files.images(self.folder, agent)

    def __repr__(self) -> str:
        """Return mission, outcome and folder: the arrays have thousands of lines."""
        figures = ", ".join(
            f"{label}: {text}" for label, text in run_html.facts(self.summary).items()
        )
        return f"<Run {self.summary['mission']!r}, {figures}, in {str(self.folder)!r}>"

    def _repr_html_(self) -> str:
        """Return the figures and a picture of the tracks, for a notebook."""
        return run_html.html(self)


def read_run(folder: Path | str, *, flown: bool = False) -> Run:
    """Return a recorded flight; of one whose program was killed, what was recorded until then.

    The outcome of the latter is ``interrupted``.

    Args:
        folder: Of the run, such as ``runs/latest``.
        flown: Whether to refuse a run that was not started, and so has no arrays.

    Raises:
        InputError: It holds no complete record, or no tick if it must have been `flown`.

    Example:
        >>> run = read_run("runs/latest")  # doctest: +SKIP
        >>> run.arrays["estimate_position"][-1]  # doctest: +SKIP
    """
    folder = Path(folder)
    if folder.is_file():
        text = f"{folder}: is a file, expected the folder of a recorded run"
        raise InputError(text, "wrong-file")
    try:
        run = _read(folder)
    except FileNotFoundError as error:
        what = "the record of an interrupted run" if (folder / "manifest.json").exists() else "none"
        text = f"{folder}: expected the folder of a recorded run, found {what}"
        raise InputError(f"{text}: no '{Path(error.filename).name}'", "no-record") from error
    except DAMAGE as error:
        why = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise InputError(f"{folder}: the record cannot be read: {why}", "no-record") from error
    if flown and not run.arrays:
        why = run.summary["reason"] or "it ended before the first tick"
        raise InputError(f"{folder}: no flight was recorded: {why}", "no-record")
    return run


@cache
def _restore() -> Callable[[Mapping[str, Any], Path], tuple[tuple[Agent, ...], World]]:
    """Return the function of the installed format that reads mission and world of a manifest."""
    return format_function("restore", Registry())


def _table(folder: Path, name: str) -> dict[str, Any]:
    """Return the columns of a table of a record, or of a record that is unfinished."""
    file, rows = folder / f"{name}.npz", folder / f"{name}.rows"
    if rows.exists() and not file.exists():
        columns = unfinished.read_rows(rows)
        if "agent" in columns:
            columns["agent"] = columns["agent"].astype(np.int64)
        return columns
    return {} if name in OPTIONAL and not file.exists() else read_arrays(file)


def _read(folder: Path) -> Run:
    """Return a recorded flight; raise one of `DAMAGE` if a file is not as it was written."""
    manifest = read_json(folder / "manifest.json")
    check_json(manifest, MANIFEST, "manifest.json")
    swarm, world = _restore()(manifest, folder / "manifest.json")
    arrays, timing, planned = (_table(folder, name) for name in ("trajectory", "timing", "paths"))
    names = tuple(str(name) for name in arrays.pop("agents", [agent.name for agent in swarm]))
    if (folder / "summary.json").exists() or not (folder / unfinished.EVENTS).exists():
        summary = {"late_ticks": 0, "compute_s": {}} | read_json(folder / "summary.json")
    else:
        events = unfinished.read_events(folder / unfinished.EVENTS)
        summary = unfinished.summary_of(manifest, names, arrays.get("time", ()), events)
    if (file := folder / "timing.json").exists():
        summary = _with_timing(summary, read_json(file))
    check_json(summary, SUMMARY, "summary.json")
    tag_columns = read_arrays(file) if (file := folder / "detections.npz").exists() else None
    detections = Detections.none() if tag_columns is None else Detections(**tag_columns)
    paths = PlannedPaths(**planned) if planned else PlannedPaths.none()
    check_arrays(arrays, names, [agent.name for agent in swarm])
    for rows in detections.agent, paths.agent:
        check_rows(rows, len(names))
    return Run(folder, manifest, summary, arrays, detections, paths, timing, names, swarm, world)
