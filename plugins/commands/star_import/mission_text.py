"""Writes the mission of an import."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from star_import.notes import Notes, show
from star_import.robots import Robot
from star_import.text import Line, word

RADIUS = 0.2  # m, of the avoider: half of what the original's grid keeps between agents


@dataclass(frozen=True, slots=True)
class Frame:
    """What stands in a mission file beside its agents and its steps.

    Attributes:
        name: Of the mission.
        made_of: Names of the files it is from.
        world: Path of its world.
        speed: Greatest, m/s.
        height: Lowest and highest to fly at, m.
        planner: As it stands in the file.
        landmarks: Whether the world has tags to find one's place by.
    """

    name: str
    made_of: str
    world: str
    speed: float
    height: tuple[float, float]
    planner: str
    landmarks: bool


def mission_lines(
    frame: Frame, robots: Sequence[Robot], steps: Sequence[Line], notes: Notes
) -> list[Line]:
    """Return a mission file."""
    localizer = "apriltag" if frame.landmarks else "flow"
    if frame.landmarks:
        notes.say(frame.name, "every agent carries an AI-deck, for the world has landmarks")
    return [
        Line(f"# Imported by `star import` from {frame.made_of}."),
        Line("star: 1"),
        Line(f"name: {word(frame.name)}"),
        Line(f"world: {word(frame.world)}"),
        Line(f"limits: {{speed: {show(frame.speed)}, height: {show(frame.height)}}}"),
        Line("swarm:"),
        *(_agent(robot, camera=frame.landmarks) for robot in robots),
        Line("transport: sim  # or radio"),
        Line(f"localizer: {localizer}"),
        Line(f"planner: {frame.planner}"),
        Line(f"avoider: {{use: orca, radius: {show(_radius(frame.name, robots, notes))}}}"),
        Line("mission:"),
        *steps,
    ]


def _agent(robot: Robot, *, camera: bool) -> Line:
    uri = f", uri: {word(robot.uri)}" if robot.uri else ""
    carries = ", camera: aideck" if camera else ""
    return Line(f"  {robot.name}: {{start: {show(robot.start)}{uri}{carries}}}", robot.place)


def _radius(name: str, robots: Sequence[Robot], notes: Notes) -> float:
    """The avoider's radius, m: smaller where agents start so near that they would overlap."""
    nearest = min(
        (math.dist(a.start, b.start) for a, b in combinations(robots, 2)), default=math.inf
    )
    least = 0.06  # m, half a Crazyflie with its propellers: nearer starts are refused
    if nearest >= 2 * RADIUS or nearest < 2 * least:
        return RADIUS
    radius = math.floor(nearest / 2 * 1000) / 1000
    notes.say(
        name,
        f"agents start {show(nearest)} m apart; the avoider's radius is {show(radius)} m "
        f"in place of {show(RADIUS)}",
    )
    return radius
