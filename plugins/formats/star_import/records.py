"""The original STAR's mission: a flat list of strings, five per record."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from star_core.formats import Value
from star_core.toolkit import shortlist
from star_import.import_log import ImportLog
from star_import.robots import NAME

FIELDS: Final = ("task", "wait or conc", "agents", "argument", "pose")
TASKS: Final = ("takeoff", "hold", "goto", "goto_velocity", "external", "land")
LONG: Final = 100.0  # s: a longer hold may have been meant in milliseconds, the README's unit


@dataclass(frozen=True, slots=True)
class Record:
    """One command of the original's mission.

    Attributes:
        task: Name of the task; empty for a record that the original skips.
        waits: Whether the next record waits for it and for those that run with it.
        agents: Names; empty for all.
        seconds: Duration of a hold.
        lands: Whether the agent lands at its goal.
        point: x, y, z of a goto, m.
        yaw: Heading of a goto, in the unit of its verb: degrees with goto_velocity, rad with goto.
        location: Source location, ``file:line:col``.
    """

    task: str
    waits: bool
    agents: tuple[str, ...]
    seconds: float
    lands: bool
    point: tuple[float, float, float]
    yaw: float
    location: str

    @property
    def line(self) -> str:
        """The line number of its beginning."""
        return self.location.split(":")[-2]


def records(file: Value, agents: Sequence[str], log: ImportLog) -> list[Record]:
    """Return the records of a mission file; invalid ones are added to the problems of `log`.

    Args:
        file: The file, with a list under ``command_sequence``.
        agents: Names of the agents.
        log: Log of assumptions.

    Raises:
        InputError: The length of the list is not a multiple of five.
    """
    strings = file.need("command_sequence")
    values = strings.list()
    log.ignore_keys(
        file, {"command_sequence", "environment", "april_tags", "robots", "robot_types"}
    )
    units = "durations are in s, positions in m, yaw in degrees (goto_velocity) or rad (goto)"
    log.assumed(strings.begins_at, units)
    if len(values) % len(FIELDS):
        raise strings.wrong(
            f"has {len(values)} strings, expected five for each record: {', '.join(FIELDS)}"
        )
    commands = []
    for i in range(0, len(values), len(FIELDS)):
        with log.collected():
            commands.append(_record(values[i : i + len(FIELDS)], agents, log))
    if commands and not commands[-1].waits:
        log.assumed(
            commands[-1].location, "the last record does not wait; its group ends with the list"
        )
    return commands


def groups(commands: Sequence[Record]) -> Iterator[list[Record]]:
    """Yield groups of records that run in parallel, each up to and including one that waits."""
    group: list[Record] = []
    for record in commands:
        group.append(record)
        if record.waits:
            yield group
            group = []
    if group:
        yield group


def _record(values: Sequence[Value], names: Sequence[str], log: ImportLog) -> Record:
    task, going_on, agents, argument, pose = (value.text().strip() for value in values)
    location = values[0].begins_at
    if task and task not in TASKS:
        raise values[0].wrong(f"no task {task!r}, expected one of {', '.join(TASKS)}")
    if going_on not in {"wait", "conc"}:
        log.assumed(values[1].begins_at, f"{going_on!r} is read as 'conc', as the original does")
    moves = task in {"goto", "goto_velocity"}
    lands = moves and argument == "land"
    if argument and not (lands or task == "hold"):
        if moves:
            raise values[3].wrong(f"argument {argument!r} of {task}, expected '' or 'land'")
        log.ignored(values[3].begins_at, f"{task or 'no task'} has no argument {argument!r}")
    if pose and not moves:
        log.ignored(values[4].begins_at, f"{task or 'no task'} has no pose {pose!r}")
    *point, yaw = _pose(values[4], task) if moves else (0.0,) * 4
    x, y, z = point
    return Record(
        task=task,
        waits=going_on == "wait",
        agents=_agents(values[2], agents, names, log) if task else (),
        seconds=_seconds(values[3], log) if task == "hold" else 0.0,
        lands=lands,
        point=(x, y, z),
        yaw=yaw,
        location=location,
    )


def _agents(value: Value, written: str, agents: Sequence[str], log: ImportLog) -> tuple[str, ...]:
    """Names of a record's agents; empty for all."""
    if written == "all":
        return ()
    if not written:
        raise value.wrong("names no agents, expected 'all' or names separated by spaces")
    names: list[str] = []
    for word in written.split():
        parts = word.split("_")
        if word not in agents and len(parts) > 1 and set(parts) <= set(agents):
            log.assumed(
                value.begins_at, f"{word!r} is read as {' '.join(parts)!r}: spaces separate names"
            )
            names += parts
        else:
            names.append(word)
    if missing := [name for name in dict.fromkeys(names) if name not in agents]:
        if not NAME.fullmatch(missing[0]):
            expected = "expected 'all' alone, or names separated by spaces"
            text = f"{missing[0]!r} is not an agent's name, {expected}"
            raise value.wrong(text)
        among = f" among {shortlist(agents)}" if agents else ""
        raise value.wrong(
            f"no agent named {missing[0]!r}{among}; add its position: "
            + log.new_agent.format(missing[0])
        )
    return tuple(dict.fromkeys(names))


def _seconds(value: Value, log: ImportLog) -> float:
    (seconds,) = _floats(value, 1, "how long to hold, s")
    if seconds < 0:
        raise value.wrong(f"{seconds:g} s is less than 0")
    if seconds >= LONG:
        log.assumed(
            value.begins_at,
            f"{seconds:g} is read as seconds, as the original's code does; its README says "
            "milliseconds",
        )
    return seconds


def _pose(value: Value, task: str) -> tuple[float, ...]:
    unit = "degrees" if task == "goto_velocity" else "rad"
    return _floats(value, 4, f"x, y, z in m and yaw in {unit}, separated by spaces")


def _floats(value: Value, count: int, expected: str) -> tuple[float, ...]:
    words = value.text().split()
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        what = f"{count} numbers" if count > 1 else "a number"
        raise value.wrong(f"{value.text()!r}, expected {what}: {expected}") from None
    return numbers
