"""Writes the mission of an import."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

from star_core.toolkit import CONTACT_RADIUS, shortlist
from star_import import firmware
from star_import.calibration import Calibration
from star_import.firmware import plain
from star_import.import_log import ImportLog, show
from star_import.motion_capture import STD, Capture
from star_import.robots import Robot
from star_import.tags import Sheet
from star_import.text import Line, word


@dataclass(frozen=True, slots=True)
class Frame:
    """The content of a mission file besides its agents and its steps.

    Attributes:
        name: Name of the mission.
        made_of: Names of its source files.
        world: Path of its world.
        speed: Speed limit, m/s.
        acceleration: Acceleration limit, m/s²; None for the default.
        height: Lowest and highest flight height, m.
        exact: Whether positions are treated as exact.
        zone: Radius of the avoider, m: half the distance that the original's grid keeps.
        planner: Value of the key ``planner``.
        tags: Whether the world has landmarks or targets.
        landmarks: Whether it has landmarks.
        cameras: Calibrations of cameras.
        pitch_deg: How far down cameras look, degrees; None for the default.
        capture: The motion-capture system that localizes the swarm, if one does.
        onboard: The positioning system whose receivers are on board, if there is one.
        reactions: Lines under ``on:``.
        numbers: Source location of the numbers of flights; empty if they are in no file.
    """

    name: str
    made_of: str
    world: str
    speed: float
    acceleration: float | None
    height: tuple[float, float]
    exact: bool
    zone: float
    planner: str
    tags: bool
    landmarks: bool
    cameras: Sequence[Calibration] = ()
    pitch_deg: float | None = None
    capture: Capture | None = None
    onboard: str = ""
    reactions: Sequence[Line] = field(default_factory=list)
    numbers: str = ""


def mission_lines(
    frame: Frame, robots: Sequence[Robot], steps: Sequence[Line], log: ImportLog
) -> list[Line]:
    """Return the lines of a mission file."""
    cameras = _cameras(frame, robots, log)
    limits = f"speed: {show(frame.speed)}, height: {show(frame.height)}"
    if frame.acceleration is not None:
        limits = f"{limits}, acceleration: {show(frame.acceleration)}"
    if frame.exact:
        limits = f"{limits}, uncertainty_margin: 0"
    carried = frame.tags or any(robot.deck for robot in robots)
    return [
        Line(f"# Imported by `star import` from {frame.made_of}."),
        Line("star: 1"),
        Line(f"name: {word(frame.name)}"),
        Line(f"world: {word(frame.world)}"),
        Line(f"limits: {{{limits}}}", frame.numbers),
        *cameras,
        Line("swarm:"),
        *(_agent(robot, _camera_of(robot, frame) if carried else "") for robot in robots),
        *_transport(frame, robots, log),
        *_localizer(frame),
        Line(f"planner: {frame.planner}", frame.numbers),
        Line(f"avoider: {{use: orca, radius: {show(_radius(frame, robots, log))}}}", frame.numbers),
        *([Line("on:"), *frame.reactions] if frame.reactions else []),
        Line("mission:"),
        *steps,
    ]


def reaction(target: Sheet, within: float, height: float, speed: float) -> list[Line]:
    """Return the lines of the reaction to a target that is to be eliminated.

    Args:
        target: Its tag.
        within: Distance from which it counts as seen, m.
        height: At which an agent flies to it, m.
        speed: At which an agent flies to it, m/s.
    """
    x, y = target.middle
    near = f"near: {{point: {show([x, y, 0.0])}, within: {show(within)}}}"
    return [
        Line(f"  - when: {{all: [{{found: {target.name}}}, {{{near}}}]}}", target.location),
        Line("    agents: first", target.location),
        Line("    then:", target.location),
        Line(
            f"      - goto: {{to: {show([x, y, height])}, speed: {show(speed)}}}", target.location
        ),
        Line("      - land: {}", target.location),
    ]


def _agent(robot: Robot, camera: str) -> Line:
    yaw = f", yaw_deg: {show(robot.yaw_deg)}" if robot.yaw_deg else ""
    uri = f", uri: {word(robot.uri)}" if robot.uri and "*" not in robot.uri else ""
    carries = f", camera: {word(camera)}" if camera else ""
    return Line(
        f"  {robot.name}: {{start: {show(robot.start)}{yaw}{uri}{carries}}}", robot.location
    )


def _camera_of(robot: Robot, frame: Frame) -> str:
    """Return the name of a robot's camera: its own, the only one there is, or an AI-deck's."""
    names = [camera.name for camera in frame.cameras]
    if robot.name in names:
        return robot.name
    if len(names) == 1:
        return names[0]
    return "deck" if frame.pitch_deg is not None else "aideck"


def _cameras(frame: Frame, robots: Sequence[Robot], log: ImportLog) -> Iterator[Line]:
    """Yield the cameras that the swarm carries, and log whose they are."""
    if not frame.tags and not any(robot.deck for robot in robots):
        for camera in frame.cameras:
            log.ignored(camera.location, "no agent has a camera: the world has no tags")
        return
    carried = dict.fromkeys(_camera_of(robot, frame) for robot in robots)
    names = {robot.name for robot in robots}
    lines = [
        camera.line(camera.name, frame.pitch_deg)
        for camera in frame.cameras
        if camera.name in carried
    ]
    if "deck" in carried and frame.pitch_deg is not None:
        lines.append(Line(f"  deck: {{pitch_deg: {show(frame.pitch_deg)}}}"))
    if lines:
        yield Line("cameras:")
        yield from lines
    for camera in frame.cameras:
        if camera.name not in carried:
            log.ignored(camera.location, "no agent has the name of this camera", camera.name)
        elif (others := names - {camera.name}) and len(frame.cameras) == 1:
            text = f"this calibration serves {shortlist(sorted(others))} too"
            log.assumed(camera.location, text)
    if "aideck" in carried:
        log.assumed(frame.name, "cameras without a calibration are AI-decks")


def _localizer(frame: Frame) -> Iterator[Line]:
    if frame.onboard:
        yield Line(f"localizer: {{use: onboard, system: {frame.onboard}}}")
        return
    if frame.capture is None:
        yield Line(f"localizer: {'apriltag' if frame.landmarks else 'flow'}")
        return
    track = ", track: markers" if frame.capture.markers else ""
    yield Line(f"localizer: {{use: mocap{track}}}" if track else "localizer: mocap")
    source = frame.capture.source or "{natnet: {host: HOST}}"
    yield Line("# on hardware, replace the line above by:", frame.capture.location)
    yield Line(f"# localizer: {{use: mocap{track}, source: {source}}}", frame.capture.location)


def _transport(frame: Frame, robots: Sequence[Robot], log: ImportLog) -> Iterator[Line]:
    """The simulator, and as comments the transport `radio` with its options for these robots."""
    decks = [robot for robot in robots if robot.deck]
    common = firmware.common(robot.parameters for robot in robots)
    own = {
        robot.name: {
            name: value for name, value in robot.parameters.items() if common.get(name) != value
        }
        for robot in robots
    }
    own = {name: parameters for name, parameters in own.items() if parameters}
    options = [*_simulated(frame, robots, common, decks=bool(decks), log=log)]
    sim = f"{{{', '.join(['use: sim', *options])}}}" if options else "sim"
    if not decks and not common and not own:
        yield Line(f"transport: {sim}  # or radio")
        return
    yield Line(f"transport: {sim}")
    yield Line("# on hardware, replace the line above by:")
    yield Line("# transport:")
    yield Line("#   use: radio")
    if common.get(firmware.CONTROLLER) == firmware.MELLINGER:
        yield Line("#   setpoints: full-state")
    if decks:
        yield Line("#   cameras:")
        yield from (
            Line(f"#     {robot.name}: {word(robot.deck)}", robot.location) for robot in decks
        )
    if common:
        yield Line("#   parameters:")
        yield from _parameters(common, "#     ")
    if own:
        yield Line("#   agent_parameters:")
        for name, parameters in own.items():
            yield Line(f"#     {name}:")
            yield from _parameters(parameters, "#       ")
    if decks and frame.tags and len(decks) < len(robots):
        others = shortlist(robot.name for robot in robots if not robot.deck)
        log.assumed(frame.name, f"no ip_add for {others}: add the AI-decks' addresses to cameras")
    log.assumed(frame.name, "what hardware needs is in comments: replace `transport: sim` by them")


def _parameters(parameters: Mapping[str, float], indent: str) -> Iterator[Line]:
    yield from (Line(f"{indent}{name}: {plain(value)}") for name, value in parameters.items())


def _simulated(
    frame: Frame,
    robots: Sequence[Robot],
    common: Mapping[str, float],
    *,
    decks: bool,
    log: ImportLog,
) -> Iterator[str]:
    """Yield the options of the simulator."""
    values = {robot.parameters.get(firmware.CONTROLLER) for robot in robots} - {None}
    value = common.get(firmware.CONTROLLER)
    if value is not None and firmware.CONTROLLERS.get(int(value)) == "mellinger":
        yield "controller: mellinger"
    elif len(values) > 1 or (value is not None and int(value) not in firmware.CONTROLLERS):
        names = ", ".join(plain(v) for v in sorted(filter(None, values)))
        text = f"{firmware.CONTROLLER} {names}: the simulator flies all agents by PID"
        log.changed(robots[0].location, text)
    if frame.capture is not None:
        yield f"positioning: {{std: {STD}}}"
    if frame.onboard:
        yield f"onboard: {{system: {frame.onboard}}}"
    if decks and not frame.tags:
        yield 'camera: {mode: "off"}'
    elif frame.tags and not frame.landmarks and frame.capture is None:
        yield "camera: {mode: geometric}"
        log.changed(
            frame.name,
            "without landmarks only simulated cameras find targets: `flow` reads no images",
        )


def _radius(frame: Frame, robots: Sequence[Robot], log: ImportLog) -> float:
    """The avoider's radius, m: reduced where agents would overlap at their start positions."""
    nearest = nearest_starts(robots)
    if nearest >= 2 * frame.zone or nearest < 2 * CONTACT_RADIUS:  # closer starts are refused
        return frame.zone
    radius = math.floor(nearest / 2 * 1000) / 1000
    log.changed(
        frame.name,
        f"agents start {show(nearest)} m apart; the avoider's radius is {show(radius)} m "
        f"instead of {show(frame.zone)}",
    )
    return radius


def nearest_starts(robots: Sequence[Robot]) -> float:
    """Return the least distance between two starts, m; inf if there are no two."""
    return min((math.dist(a.start, b.start) for a, b in combinations(robots, 2)), default=math.inf)
