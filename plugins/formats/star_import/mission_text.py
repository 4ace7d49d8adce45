"""Writes the mission of an import."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from star_core.toolkit import shortlist
from star_import.firmware import CONTROLLER, MELLINGER, plain
from star_import.import_log import ImportLog, show
from star_import.robots import Robot
from star_import.text import Line, word


@dataclass(frozen=True, slots=True)
class Frame:
    """The content of a mission file besides its agents and its steps.

    Attributes:
        name: Name of the mission.
        made_of: Names of its source files.
        world: Path of its world.
        speed: Speed limit, m/s.
        height: Lowest and highest flight height, m.
        zone: Radius of the avoider, m: half the distance that the original's grid keeps.
        planner: Value of the key ``planner``.
        landmarks: Whether the world has landmarks.
        positioning: The system that localized the swarm; empty if no file names one.
        parameters: Firmware parameters to set in every agent, by ``group.name``.
    """

    name: str
    made_of: str
    world: str
    speed: float
    height: tuple[float, float]
    zone: float
    planner: str
    landmarks: bool
    positioning: str
    parameters: Mapping[str, float]


def mission_lines(
    frame: Frame, robots: Sequence[Robot], steps: Sequence[Line], log: ImportLog
) -> list[Line]:
    """Return the lines of a mission file."""
    localizer = "apriltag" if frame.landmarks else "flow"
    decks = ""
    if frame.positioning:
        decks = "  # needs a Flow deck on each drone"
        log.warning(
            frame.name,
            f"this swarm was localized by {frame.positioning}; it is flown by `{localizer}`, which "
            "needs a Flow deck on each drone; see localizer `mocap` for the alternative",
        )
    if frame.landmarks:
        log.add(frame.name, "every agent carries an AI-deck, since the world has landmarks")
    return [
        Line(f"# Imported by `star import` from {frame.made_of}."),
        Line("star: 1"),
        Line(f"name: {word(frame.name)}"),
        Line(f"world: {word(frame.world)}"),
        Line(f"limits: {{speed: {show(frame.speed)}, height: {show(frame.height)}}}"),
        Line("swarm:"),
        *(_agent(robot, camera=frame.landmarks or bool(robot.deck)) for robot in robots),
        *_transport(frame, robots, log),
        Line(f"localizer: {localizer}{decks}"),
        Line(f"planner: {frame.planner}"),
        Line(f"avoider: {{use: orca, radius: {show(_radius(frame, robots, log))}}}"),
        Line("mission:"),
        *steps,
    ]


def _agent(robot: Robot, *, camera: bool) -> Line:
    yaw = f", yaw_deg: {show(robot.yaw_deg)}" if robot.yaw_deg else ""
    uri = f", uri: {word(robot.uri)}" if robot.uri else ""
    carries = ", camera: aideck" if camera else ""
    return Line(
        f"  {robot.name}: {{start: {show(robot.start)}{yaw}{uri}{carries}}}", robot.location
    )


def _transport(frame: Frame, robots: Sequence[Robot], log: ImportLog) -> Iterator[Line]:
    """The simulator, and as comments the transport `radio` with its options for these robots."""
    decks = [robot for robot in robots if robot.deck]
    if not decks and not frame.parameters:
        yield Line("transport: sim  # or radio")
        return
    if decks and not frame.landmarks:
        yield Line('transport: {use: sim, camera: {mode: "off"}}  # the world has no landmarks')
    else:
        yield Line("transport: sim")
    yield Line("# on hardware, replace the line above by:")
    yield Line("# transport:")
    yield Line("#   use: radio")
    if frame.parameters.get(CONTROLLER) == MELLINGER:
        log.add(
            frame.name,
            f"{CONTROLLER} {MELLINGER} is Mellinger's, which tracks positions: on hardware with "
            "setpoints: full-state",
        )
        yield Line("#   setpoints: full-state")
    if decks:
        yield Line("#   cameras:")
        yield from (
            Line(f"#     {robot.name}: {word(robot.deck)}", robot.location) for robot in decks
        )
    if frame.parameters:
        yield Line("#   parameters:")
        for name, value in frame.parameters.items():
            yield Line(f"#     {name}: {plain(value)}")
    if decks and frame.landmarks and len(decks) < len(robots):
        others = shortlist(robot.name for robot in robots if not robot.deck)
        log.add(frame.name, f"no ip_add for {others}: add the AI-decks' addresses to cameras")
    described = [f"{name} {plain(value)}" for name, value in frame.parameters.items()]
    described += [f"AI-deck of {robot.name} at {robot.deck}" for robot in decks]
    log.add(frame.name, f"commented out, for the radio transport: {', '.join(described)}")


def _radius(frame: Frame, robots: Sequence[Robot], log: ImportLog) -> float:
    """The avoider's radius, m: reduced where agents would overlap at their start positions."""
    nearest = min(
        (math.dist(a.start, b.start) for a, b in combinations(robots, 2)), default=math.inf
    )
    least = 0.06  # m, half a Crazyflie with its propellers: closer starts are refused
    if nearest >= 2 * frame.zone or nearest < 2 * least:
        return frame.zone
    radius = math.floor(nearest / 2 * 1000) / 1000
    log.add(
        frame.name,
        f"agents start {show(nearest)} m apart; the avoider's radius is {show(radius)} m "
        f"instead of {show(frame.zone)}",
    )
    return radius
