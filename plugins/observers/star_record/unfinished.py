"""The record of a flight whose program ended before the flight did, as far as it was written.

While a flight is recorded, the rows of its tables are in ``NAME.rows`` and its events in
``events.jsonl``, which are removed when the record is complete. A file of rows has the header of an
array of NumPy, whose length is that of the file.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from star_record.record_files import KINDS, regular

EVENTS: Final = "events.jsonl"
OUTCOME: Final = "interrupted"
MAX_EVENTS: Final = 100_000_000  # bytes
OPTIONAL: Final = ("truth_position", "truth_attitude", "signal")  # NaN where unknown


def read_rows(file: Path) -> dict[str, Any]:
    """Return the columns of a table that was written row by row, without a last row that is torn.

    Raises:
        OSError: It cannot be read.
        ValueError: It is no such file.
    """
    size = regular(file).stat().st_size
    if size == 0:  # no row was written
        return {}
    with file.open("rb") as stream:
        np.lib.format.read_magic(stream)
        _shape, _order, dtype = np.lib.format.read_array_header_1_0(stream)
        fields = {} if dtype.fields is None else dtype.fields
        kinds = {field[0].base.kind for field in fields.values()}
        if not (fields and kinds <= {*KINDS}):
            raise ValueError(f"{file.name} has rows of {dtype}")
        count = (size - stream.tell()) // dtype.itemsize
        table = np.fromfile(stream, dtype, count)
    columns = {name: np.ascontiguousarray(table[name]) for name in fields if count}
    for name in OPTIONAL:
        if name in columns and np.isnan(columns[name]).all():
            del columns[name]
    return columns


def read_events(file: Path) -> list[dict[str, Any]]:
    """Return the events that were written, without a last line that is torn.

    Raises:
        OSError: It cannot be read.
        ValueError: It is too large, or a line is no JSON.
    """
    if not file.exists():
        return []
    lines = regular(file, MAX_EVENTS).read_bytes().split(b"\n")
    return [json.loads(line) for line in lines[:-1]]


def summary_of(
    manifest: Mapping[str, Any], agents: Sequence[str], time: Any, events: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the summary of an interrupted flight; figures that only a whole flight has are None.

    Args:
        manifest: Of the record.
        agents: Their names.
        time: (T,) mission times of the ticks, s.
        events: So far.
    """
    last = float(time[-1]) if len(time) else 0.0
    contacts = [event.get("details", {}) for event in events if event["kind"] == "collision"]
    obstacles = sum("obstacle" in contact for contact in contacts)
    discoveries = [event for event in events if event["kind"] == "found"]
    targets = manifest.get("world", {}).get("targets", {})
    return {
        "outcome": OUTCOME,
        "reason": f"the program ended at {last:.2f} s, before the flight did",
        "mission": manifest["mission"]["name"],
        "seed": manifest["mission"].get("seed", 0),
        "agents": list(agents),
        "flight_time_s": last - float(time[0]) if len(time) else 0.0,
        "collisions": {"agent_agent": len(contacts) - obstacles, "agent_obstacle": obstacles},
        "distances_from": "mixed",
        "min_separation_m": None,
        "min_clearance_m": None,
        "targets": {
            "found": len(discoveries),
            "total": max(len(targets), len(discoveries)),
            "list": [],
        },
        "steps": list(_steps(events)),
        "events": events,
        "late_ticks": 0,
        "compute_s": {},
    }


def _steps(events: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the steps that events report; those that had not ended last to the end."""
    running: list[dict[str, Any]] = []
    for event in events:
        details = event.get("details", {})
        if event["kind"] != "step" or "verb" not in details:
            continue
        same = next((step for step in running if all(step[k] == details[k] for k in details)), None)
        if same is not None:
            same["ended_s"] = event["time"]
            running.remove(same)
        elif " begins" in event["text"]:  # also "begins, until ..."
            running.append({**details, "begun_s": event["time"], "ended_s": None})
            yield running[-1]
