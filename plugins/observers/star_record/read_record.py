"""Reads the folder of a recorded flight."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from star_core import Agent, Detections, InputError, Run, World
from star_core.toolkit import PlannedPaths
from star_record import record_files, run_html, unfinished
from star_record.record_files import (
    MANIFEST,
    SUMMARY,
    check_arrays,
    check_json,
    check_rows,
    read_arrays,
    read_json,
)

Restore: TypeAlias = Callable[[Mapping[str, Any], Path], tuple[tuple[Agent, ...], World]]
"""Returns the agents and the world of a manifest, as `FormatSpec` describes it."""

OPTIONAL: Final = ("timing", "paths")
"""Tables that a complete record may lack."""

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


class RecordedRun(Run):
    """A recorded flight whose images are in its folder, and which notebooks show."""

    def images(self, agent: str) -> dict[int, Path]:
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


def read_record(folder: Path, restore: Restore) -> Run:
    """Return the record in a folder.

    Raises:
        InputError: It holds no complete record.
    """
    if folder.is_file():
        text = f"{folder}: is a file, expected the folder of a recorded run"
        raise InputError(text, "wrong-file")
    try:
        return _read(folder, restore)
    except FileNotFoundError as error:
        what = "the record of an interrupted run" if (folder / "manifest.json").exists() else "none"
        text = f"{folder}: expected the folder of a recorded run, found {what}"
        raise InputError(f"{text}: no '{Path(error.filename).name}'", "no-record") from error
    except Exception as error:  # whatever the readers of JSON, ZIP and arrays raise for damage
        why = f"{type(error).__name__}: {error}".partition("\n")[0]
        raise InputError(f"{folder}: the record cannot be read: {why}", "no-record") from error


def _table(folder: Path, name: str) -> dict[str, Any]:
    """Return the columns of a table of a record, or of a record that is unfinished."""
    file, rows = folder / f"{name}.npz", folder / f"{name}.rows"
    if rows.exists() and not file.exists():
        columns = unfinished.read_rows(rows)
        if "agent" in columns:
            columns["agent"] = columns["agent"].astype(np.int64)
        return columns
    return {} if name in OPTIONAL and not file.exists() else read_arrays(file)


def _read(folder: Path, restore: Restore) -> Run:
    """Return the record in a folder; raise an exception if a file is not as it was written."""
    manifest = read_json(folder / "manifest.json")
    check_json(manifest, MANIFEST, "manifest.json")
    swarm, world = restore(manifest, folder / "manifest.json")
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
    return RecordedRun(
        folder, manifest, summary, arrays, detections, paths, timing, names, swarm, world
    )
