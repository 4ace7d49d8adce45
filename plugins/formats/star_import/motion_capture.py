"""Motion capture of an import: the system of ``motion_capture.yaml``, and agents it measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from star_core.formats import Value
from star_core.toolkit import shortlist
from star_import.import_log import ImportLog
from star_import.robots import Robot
from star_import.text import word

STD: Final = 0.002  # m, of the simulated system: localizer `mocap`'s default
SOURCES: Final[Mapping[str, tuple[str, str]]] = {
    "optitrack": ("natnet", "{{host: {host}}}"),
    "optitrack_closed_source": ("natnet", "{{host: {host}}}"),
    "qualisys": ("qtm", "{{host: {host}}}"),
}
"""Sources of localizer `mocap`, with their options, by the type of the system."""
OTHER: Final = ("motioncapture", "{{type: {type}, host: {host}}}")
READ: Final = ("type", "hostname", "marker_configurations", "mode", "topics")


@dataclass(frozen=True, slots=True)
class Capture:
    """A motion-capture system that localizes the swarm.

    Attributes:
        source: Source and its options as YAML; empty if no file names the system.
        markers: Whether each agent has one marker only.
        location: Source location, ``file:line:col``; empty without a file.
    """

    source: str
    markers: bool
    location: str


def capture(file: Value | None, swarm: Sequence[Robot], log: ImportLog) -> Capture | None:
    """Return the system that measures all agents of a swarm, or None if there is none.

    Args:
        file: Content of ``motion_capture.yaml``, if there is one.
        swarm: The agents.
        log: Log of assumptions.
    """
    tracked = [robot for robot in swarm if robot.tracked]
    if file is not None and not tracked:
        log.ignored(file.begins_at, "no robot is measured by motion capture")
    if not tracked:
        return None
    if len(tracked) < len(swarm):
        others = shortlist(robot.name for robot in swarm if not robot.tracked)
        log.changed(
            tracked[0].location,
            "motion capture measures these, but a mission has one localizer for all, and motion "
            f"capture does not measure {others}; none is localized by it",
            shortlist(robot.name for robot in tracked),
        )
        return None
    names = dict.fromkeys(robot.marker for robot in swarm if robot.marker)
    if file is None:
        where = tracked[0].location
        log.assumed(where, "the swarm is localized by motion capture; no file names the system")
        return Capture("", all("single" in name for name in names) and bool(names), "")
    with log.collected():
        return _of_file(file, list(names), log)
    return None


def _of_file(file: Value, names: Sequence[str], log: ImportLog) -> Capture:
    """Return the system of a file for markers of some configurations."""
    (top,) = file.map().values()
    keys = top.need("ros__parameters")
    kind, host = keys.need("type").text(), ""
    if "hostname" in keys.map():
        host = keys.map()["hostname"].text()
    source, options = SOURCES.get(kind, OTHER)
    log.ignore_keys(keys, READ, why="is not supported by localizer `mocap`")
    configurations = keys.map()["marker_configurations"].map() if (
        "marker_configurations" in keys.map()
    ) else {}  # fmt: skip
    counts = []
    for name in names:
        if name not in configurations:
            log.ignored(file.begins_at, "these markers are not in 'marker_configurations'", name)
            continue
        marker = configurations[name]
        counts.append(len(marker.need("points").map()))
        if "offset" in marker.map() and any(marker.map()["offset"].numbers()):
            where = marker.map()["offset"].begins_at
            log.changed(where, "the offset of the markers from the drone is not applied", name)
    single = bool(counts) and all(count == 1 for count in counts)
    if not single:
        text = "the system names bodies as the agents; localizer `mocap` has `bodies` for others"
        log.assumed(keys.begins_at, text)
    text = options.format(type=word(kind), host=word(host))
    return Capture(f"{{{source}: {text}}}", single, keys.begins_at)
