"""Puts what was read together into a mission and its world."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from star_core import InputError
from star_import.made import Made
from star_import.mission_text import Frame, mission_lines
from star_import.notes import Notes, show
from star_import.obstacles import Wall, walls
from star_import.records import Record, records
from star_import.robots import Robot, given_on_the_command_line, robots
from star_import.sources import Sources
from star_import.steps import CLIMB, REACHED, ZONE, Steps
from star_import.tags import Reading, sheets
from star_import.text import Line, word
from star_import.world_text import Room, around, corners, world_lines

FLIGHT: Final = 0.1  # m/s, the original's greatest velocity, as shipped
CRUISE: Final = 0.5  # m/s, for trajectories: what STAR's missions fly at most if nothing is said
HEIGHTS: Final = (0.5, 2.0)  # m, the original's lowest and highest
LOW: Final = 0.2  # m, the lowest for trajectories, whose z often goes down from the take-off
TRAJECTORY_HEIGHT: Final = 1.0  # m, to which Crazyswarm2's own examples take off
MARGIN: Final = 1.0  # m, around everything that a file names
WIDE: Final = 3.0  # m, around agents that fly trajectories, which lead nobody knows where


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the command line says.

    Attributes:
        name: Of the mission; None takes that of a file.
        agents: ``NAME=X,Y`` each.
        fence: None draws it around everything.
        edge: Of tags, m.
        corners: Whether places of tags are those of their corners.
        placed: Where targets lie that have no place, m.
        speed: Of flights, m/s.
        timescale: Of trajectories.
        as_executed: Whether to keep what the original did where it meant something else.
    """

    name: str | None
    agents: Sequence[str]
    fence: Room | None
    edge: float
    corners: bool
    placed: Mapping[int, tuple[float, float]]
    speed: float | None
    timescale: float
    as_executed: bool


def assemble(sources: Sources, wishes: Wishes, notes: Notes) -> Made:
    """Return what files make.

    Raises:
        InputError: They cannot be imported; every reason found is listed.
    """
    swarm = _swarm(sources, wishes, notes)
    built = walls(sources.environment[1], notes) if sources.environment else []
    reading = Reading(wishes.edge, wishes.corners, wishes.placed)
    printed = sheets(sources.environment[1], reading, notes) if sources.environment else []
    found: list[Record] = []
    if sources.mission:
        with notes.collected():
            found = records(sources.mission[1], [robot.name for robot in swarm], notes)
    notes.settle()
    _told(sources, notes, as_executed=wishes.as_executed, built=built)
    points = corners(built, printed) + [robot.start[:2] for robot in swarm]
    points += [record.point[:2] for record in found if record.task.startswith("goto")]
    room = wishes.fence or around(points or [(0.0, 0.0)], WIDE if sources.trajectories else MARGIN)
    if wishes.fence is None:
        notes.say("fence", f"no file says one; from {show(room.low)} to {show(room.high)} m")
    files = [one for one in (sources.mission, sources.environment, sources.robots) if one]
    made_of = ", ".join([path.name for path, _ in files] + [p.name for p in sources.trajectories])
    name = _named(wishes.name or (files[0][0].stem if files else sources.trajectories[0].stem))
    world = _named(sources.environment[0].stem if sources.environment else f"{name}-room")
    place = f"worlds/{world}.yaml"
    lines = {place: world_lines(world, made_of, room, built, printed)}
    if not swarm:
        return Made(lines, None, place, room)
    frame = Frame(
        name=name,
        made_of=made_of,
        world=place,
        speed=max(CLIMB, _speed(sources, wishes)),
        height=HEIGHTS if sources.mission else (LOW, HEIGHTS[1]),
        planner=_planner(built, wishes, notes),
        landmarks=any(sheet.kind == "landmarks" for sheet in printed),
    )
    notes.say(name, _chosen(frame, found, _speed(sources, wishes)))
    steps = _steps(sources, found, swarm, wishes, notes)
    lines[f"{name}.yaml"] = mission_lines(frame, swarm, steps, notes)
    copies = {f"paths/{path.name}": path for path in sources.trajectories}
    return Made(lines, f"{name}.yaml", place, room, copies)


def _swarm(sources: Sources, wishes: Wishes, notes: Notes) -> list[Robot]:
    """Everybody that a file or the command line names."""
    found = given_on_the_command_line(wishes.agents)
    if sources.robots:
        with notes.collected():
            found = [*robots(sources.robots[1], notes), *found]
    names = [robot.name for robot in found]
    for robot in found[len(found) - len(wishes.agents) :]:
        if names.count(robot.name) > 1:
            notes.problems.append(f"{robot.place}: another agent is called {robot.name!r}")
    if not found and not notes.problems and (sources.mission or sources.trajectories):
        first = sources.mission[0] if sources.mission else sources.trajectories[0]
        notes.problems.append(
            f"{first}: does not say where the agents stand; give crazyflies.yaml too, or "
            "--agent NAME=X,Y for each"
        )
    return found


def _told(sources: Sources, notes: Notes, *, as_executed: bool, built: Sequence[Wall]) -> None:
    """Say what is so of every such import."""
    if sources.mission:
        where = str(sources.mission[0])
        notes.say(where, "the original has no time-outs but at take-off; every step has one here")
        if built and not as_executed:
            notes.say(where, "the planner keeps 0.2 m from obstacles, the original kept nothing")


def _chosen(frame: Frame, found: Sequence[Record], speed: float) -> str:
    """Say which numbers of the mission no file says."""
    low, high = frame.height
    said = [f"limits.speed {show(frame.speed)} m/s", f"limits.height {show(low)} to {show(high)} m"]
    if any(record.task.startswith("goto") for record in found):
        said += [f"of goto: speed {show(speed)} m/s", f"within {show(REACHED)} m"]
        said += [f"spacing {show(2 * ZONE)} m where several fly to one place"]
    return f"numbers that no file says: {', '.join(said)}"


def _planner(built: Sequence[Wall], wishes: Wishes, notes: Notes) -> str:
    if not built:
        return "straight"
    if wishes.as_executed:
        notes.say("planner", "keeps nothing from obstacles, as executed")
        return "{use: visibility, clearance: 0}"
    return "visibility"


def _speed(sources: Sources, wishes: Wishes) -> float:
    return wishes.speed or (FLIGHT if sources.mission else CRUISE)


def _steps(
    sources: Sources,
    found: Sequence[Record],
    swarm: Sequence[Robot],
    wishes: Wishes,
    notes: Notes,
) -> list[Line]:
    names = [robot.name for robot in swarm]
    speed = _speed(sources, wishes)
    lines: list[Line] = []
    if sources.mission:
        writer = Steps(names, speed, notes, as_executed=wishes.as_executed)
        lines = writer.write(found)
        if sources.trajectories:
            notes.say(str(sources.mission[0]), "trajectories are flown after its commands")
    if sources.trajectories or not sources.mission:
        notes.say("mission", f"no file says a take-off to {TRAJECTORY_HEIGHT:g} m and a landing; "
                  "both are put around what is flown")  # fmt: skip
        lines.append(Line(f"  - takeoff: {{height: {TRAJECTORY_HEIGHT:g}}}"))
        for path in sources.trajectories:
            notes.say(
                str(path),
                "durations in s, x, y and z in m, yaw in rad; flown by all, each from where it is",
            )
            slow = f", timescale: {show(wishes.timescale)}" if wishes.timescale != 1.0 else ""
            lines.append(
                Line(
                    f"  - follow: {{file: {word(f'paths/{path.name}')}, format: poly7{slow}}}",
                    str(path),
                )
            )
        lines.append(Line("  - land: {}"))
    return lines


def _named(text: str) -> str:
    """A name that a mission may have, as near to `text` as can be."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-_")[:64]
    if not name:
        raise InputError([f"{text!r} has no letter to make a name of; give --name"])
    return name
