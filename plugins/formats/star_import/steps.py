"""Converts the original STAR's records to steps of a mission."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from star_core.toolkit import shortlist
from star_import.config import Config
from star_import.import_log import ImportLog, show
from star_import.records import Record, groups
from star_import.text import Line

PORT: Final = 5799  # default of `external`


class Steps:
    """Writes records as steps, and logs how each was interpreted.

    Args:
        names: Names of all agents.
        config: The original's numbers.
        speed: Flight speed, m/s.
        as_executed: Whether to reproduce what the original did where that differs from the intent.
        log: Log of assumptions.
    """

    def __init__(
        self,
        names: Sequence[str],
        config: Config,
        speed: float,
        log: ImportLog,
        *,
        as_executed: bool,
    ) -> None:
        self._names = tuple(names)
        self._config = config
        self._speed = speed
        self._executed = as_executed
        self._log = log
        self._up: set[str] = set()
        self._externals = 0  # of the group that is written

    def write(self, commands: Sequence[Record]) -> list[Line]:
        """Return the lines of the steps under ``mission:``, indented by two spaces."""
        lines: list[Line] = []
        some = False
        for group in groups(commands):
            self._externals = 0
            steps = []
            for record in group:
                texts, why = list(self._steps(record)), "in the air already"
                if not record.task:
                    self._log.ignored(record.location, "records without a task are skipped")
                    why = "no task, ignored"
                if texts:
                    steps.append((record, texts))
                else:
                    lines.append(Line(f"  # line {record.line}: {why}", record.location))
            some = some or bool(steps)
            lines += self._together(steps)
        if not some:
            self._log.assumed("command_sequence", "is empty, and so is the mission")
            lines.append(Line("  - hold: {}  # the original's list of commands is empty"))
        return lines

    def _together(self, steps: Sequence[tuple[Record, Sequence[str]]]) -> Iterator[Line]:
        """Lines of the records of one group."""
        if len(steps) == 1:
            ((record, texts),) = steps
            yield from (
                Line(f"  - {text}  # line {record.line}", record.location) for text in texts
            )
        elif steps:
            yield Line("  - parallel:", steps[0][0].location)
            for record, texts in steps:
                end = f"  # line {record.line}"
                if len(texts) == 1:
                    yield Line(f"      - {texts[0]}{end}", record.location)
                else:
                    yield Line("      - repeat:", record.location)
                    yield Line("          times: 1", record.location)
                    yield Line("          steps:", record.location)
                    for text in texts:
                        yield Line(f"            - {text}{end}", record.location)

    def _steps(self, record: Record) -> Iterator[str]:
        """Return the steps of one record."""
        if not record.task:
            return
        agents = f"agents: [{', '.join(record.agents)}]" if record.agents else ""
        flying = set(record.agents or self._names)
        silence = show(self._config.silence)
        if record.task not in {"takeoff", "land"} and (grounded := sorted(flying - self._up)):
            self._changed(record, f"{shortlist(grounded)}: not airborne at this point")
        match record.task:
            case "takeoff":
                yield from self._takeoff(record)
            case "hold":
                yield f"hold: {{{_joined(agents, f'for: {show(record.seconds)}')}}}"
            case "land":
                self._up -= flying
                yield f"land: {{{agents}}}"
            case "external":
                self._changed(
                    record,
                    f"the program of external uses STAR's messages instead of ROS; the step ends "
                    f"after {silence} s of silence",
                )
                end = f"max_silence: {silence}, on_silence: fail, on_failure: continue"
                end += f", response_timeout: {silence}"
                if self._externals:
                    port = PORT + self._externals
                    end += f", port: {port}"
                    text = f"external beside another listens at port {port}, for a program each"
                    self._changed(record, text)
                self._externals += 1
                yield f"external: {{{_joined(agents, end)}}}"
            case "goto" if self._executed:
                end = ", nor does it land" if record.lands else ""
                self._assumed(record, f"goto does not move{end}, as executed: hold for 0 s")
                yield f"hold: {{{agents}}}"
            case _:
                yield from self._flight(record, agents)

    def _takeoff(self, record: Record) -> Iterator[str]:
        """Yield the take-off of the agents of a record that are on the ground, if any are."""
        named = record.agents
        if named and self._executed:
            self._assumed(record, "takeoff is sent to all agents, as executed")
            named = ()
        if up := [name for name in named or self._names if name in self._up]:
            self._changed(record, f"{shortlist(up)}: in the air already, no take-off")
        grounded = [name for name in named or self._names if name not in self._up]
        if not grounded:
            return
        self._up |= {*grounded}
        agents = f"agents: [{', '.join(grounded)}]" if named or up else ""
        height, climb = show(self._config.height), show(self._config.climb)
        yield f"takeoff: {{{_joined(agents, f'height: {height}, speed: {climb}')}}}"

    def _flight(self, record: Record, agents: str) -> Iterator[str]:
        x, y, z = record.point
        yaw = record.yaw if record.task == "goto_velocity" else math.degrees(record.yaw)
        if record.task == "goto_velocity" and 0 < abs(yaw) <= math.tau:
            self._assumed(
                record,
                "yaw is read as degrees, as the original's code does for goto_velocity only; "
                f"{show(yaw)} rad would be {show(math.degrees(yaw))} degrees",
            )
        end = f"yaw_deg: {show(yaw)}, speed: {show(self._speed)}"
        within = f"within: {show(self._config.reached)}"
        if self._executed:
            yield from self._grid(record, f"{end}, {within}")
        else:
            spacing = ""
            if len(record.agents or self._names) > 1:
                spacing = f"spacing: {show(2 * self._config.zone)}"
                if (near := self._config.zone / 2) < self._config.reached:
                    within = f"within: {show(near)}"
                    text = f"agents at one goal come within {show(near)} m, so that they land apart"
                    self._changed(record, text)
            yield f"goto: {{{_joined(agents, f'to: {show([x, y, z])}, {end}', spacing, within)}}}"
        if record.lands:
            self._up -= set(record.agents or self._names)
            if record.task == "goto":
                self._assumed(
                    record, "lands at its goal, which the original did for goto_velocity only"
                )
            yield f"land: {{{agents}}}"

    def _grid(self, record: Record, end: str) -> Iterator[str]:
        """Yield the flight of agents to the corners of the grid that the original makes.

        Of n agents, with d = ceil(sqrt(n)) and a protected zone p, agent k flies to
        x - p d + 2 p (k div d), y - p d + 2 p (k mod d); the agents are in the order of the record
        or, if it names none, in that of their names.
        """
        names = record.agents or sorted(self._names)
        (x, y, z), zone = record.point, self._config.zone
        side = math.ceil(math.sqrt(len(names)))
        low = -zone * side
        self._assumed(
            record, "agents fly to the corners of a grid, as executed", show([low, low]) + " m"
        )
        goals = []
        for k, name in enumerate(names):
            goal = [x + low + 2 * zone * (k // side), y + low + 2 * zone * (k % side), z]
            goals.append(f"goto: {{agents: [{name}], to: {show(goal)}, {end}}}")
        yield goals[0] if len(goals) == 1 else f"parallel: [{', '.join(f'{{{g}}}' for g in goals)}]"

    def _assumed(self, record: Record, message: str, about: str = "") -> None:
        self._log.assumed(record.location, message, about)

    def _changed(self, record: Record, message: str) -> None:
        self._log.changed(record.location, message)


def _joined(*parts: str) -> str:
    return ", ".join(part for part in parts if part)
