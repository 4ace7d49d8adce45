"""The original STAR's records as steps of a mission."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from star_import.notes import Notes, show
from star_import.records import Record, groups
from star_import.text import Line

HEIGHT: Final = 0.8  # m, the original's height of take-off, as shipped
CLIMB: Final = 0.2  # m/s, its speed
ZONE: Final = 0.2  # m, its protected zone; agents at one goal stand two of these apart
REACHED: Final = 0.2  # m, how near it calls a goal reached
SILENCE: Final = 5.0  # s, after which it takes an external program to be done
BIAS: Final = (-ZONE, -ZONE)  # m, by which its grid moves the goals of goto_velocity


class Steps:
    """Writes records as steps, and tells what each was read as.

    Args:
        names: Of every agent.
        speed: Of flights, m/s.
        as_executed: Whether to keep what the original did where it meant something else.
        notes: Told what was assumed.
    """

    def __init__(
        self, names: Sequence[str], speed: float, notes: Notes, *, as_executed: bool
    ) -> None:
        self._names = tuple(names)
        self._speed = speed
        self._executed = as_executed
        self._notes = notes
        self._up: set[str] = set()

    def write(self, found: Sequence[Record]) -> list[Line]:
        """Return the lines of the steps under ``mission:``, two spaces in."""
        lines: list[Line] = []
        some = False
        for group in groups(found):
            steps = [(record, list(self._steps(record))) for record in group if record.task]
            for record in group:
                if not record.task:
                    self._notes.say(record.place, "has no task: the original skips it; left out")
                    lines.append(Line(f"  # line {record.line}: no task, left out", record.place))
            some = some or bool(steps)
            lines += self._together(steps)
        if not some:
            self._notes.say("the list of commands", "is empty; so is the mission: nobody moves")
            lines.append(Line("  - hold: {}  # the original's list of commands is empty"))
        return lines

    def _together(self, steps: Sequence[tuple[Record, Sequence[str]]]) -> Iterator[Line]:
        """The lines of the records of one group."""
        if len(steps) == 1:
            ((record, texts),) = steps
            yield from (Line(f"  - {text}  # line {record.line}", record.place) for text in texts)
        elif steps:
            yield Line("  - parallel:", steps[0][0].place)
            for record, texts in steps:
                end = f"  # line {record.line}"
                if len(texts) == 1:
                    yield Line(f"      - {texts[0]}{end}", record.place)
                else:
                    yield Line("      - repeat:", record.place)
                    yield Line("          times: 1", record.place)
                    yield Line("          steps:", record.place)
                    for text in texts:
                        yield Line(f"            - {text}{end}", record.place)

    def _steps(self, record: Record) -> Iterator[str]:
        """One record as steps."""
        who = ", ".join(record.agents) or "all"
        agents = f"agents: [{', '.join(record.agents)}]" if record.agents else ""
        flying = set(record.agents or self._names)
        if record.task not in {"takeoff", "land"} and (grounded := sorted(flying - self._up)):
            self._say(record, f"{', '.join(grounded)}: has not taken off by then")
        match record.task:
            case "takeoff":
                if record.agents and self._executed:
                    self._say(record, "takeoff is sent to all, whoever is named, as executed")
                    agents, who, flying = "", "all", set(self._names)
                self._say(record, f"takeoff of {who} to {HEIGHT:g} m at {CLIMB:g} m/s")
                self._up |= flying
                height = f"height: {HEIGHT:g}, speed: {CLIMB:g}"
                yield f"takeoff: {{{_joined(agents, height)}}}"
            case "hold":
                self._say(record, f"hold of {who} for {show(record.seconds)} s")
                yield f"hold: {{{_joined(agents, f'for: {show(record.seconds)}')}}}"
            case "land":
                self._say(record, f"land of {who}, each where it is")
                self._up -= flying
                yield f"land: {{{agents}}}"
            case "external":
                self._say(
                    record,
                    f"external for {who}: the program no longer speaks ROS but STAR's messages; "
                    f"over when it is silent for {SILENCE:g} s",
                )
                end = f"silence: {SILENCE:g}, then: fail, on_failure: continue"
                yield f"external: {{{_joined(agents, end)}}}"
            case "goto" if self._executed:
                end = ", nor does it land" if record.lands else ""
                self._say(record, f"goto of {who} moves nobody{end}, as executed: a hold of 0 s")
                yield f"hold: {{{agents}}}"
            case _:
                yield from self._flight(record, agents, who)

    def _flight(self, record: Record, agents: str, who: str) -> Iterator[str]:
        x, y, z = record.point
        yaw = record.yaw if record.task == "goto_velocity" else math.degrees(record.yaw)
        unit = "degrees" if record.task == "goto_velocity" else "rad"
        self._say(
            record,
            f"{record.task} of {who} to {show([x, y, z])} m, yaw {show(record.yaw)} {unit}",
        )
        if record.task == "goto_velocity" and 0 < abs(yaw) <= math.tau:
            self._say(
                record,
                f"yaw {show(yaw)} is taken for degrees, as the original's code does with "
                f"goto_velocity only; rad would be {show(math.degrees(yaw))} degrees",
            )
        if self._executed:
            x, y = x + BIAS[0], y + BIAS[1]
            self._say(record, f"its grid moves the goal by {show(list(BIAS))} m, as executed")
        goal = f"to: {show([x, y, z])}, yaw_deg: {show(yaw)}, speed: {show(self._speed)}"
        many = len(record.agents or self._names) > 1
        spacing = f"spacing: {2 * ZONE:g}" if many else ""
        yield f"goto: {{{_joined(agents, goal, spacing, f'within: {REACHED:g}')}}}"
        if record.lands:
            self._up -= set(record.agents or self._names)
            if record.task == "goto":
                self._say(
                    record, "lands at its goal, which the original did for goto_velocity only"
                )
            yield f"land: {{{agents}}}"

    def _say(self, record: Record, message: str) -> None:
        self._notes.say(record.place, message)


def _joined(*parts: str) -> str:
    return ", ".join(part for part in parts if part)
