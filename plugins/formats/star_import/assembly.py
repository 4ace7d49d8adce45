"""Assembles the imported data into a mission and its world."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

from star_core import InputError, Registry, load
from star_core.formats import Value
from star_core.toolkit import actions
from star_import.beacons import Beacon, beacons, system
from star_import.calibration import Calibration, calibration
from star_import.config import Config, config
from star_import.import_log import ImportLog, show
from star_import.mission_text import Frame, mission_lines, nearest_starts, reaction
from star_import.motion_capture import capture
from star_import.obstacles import Wall, has_inside, walls
from star_import.output_files import TOP, OutputFiles, Room, around, corners
from star_import.records import Record, records
from star_import.robots import Robot, command_line_agents, positioning, robots
from star_import.sources import MOST, Sources, misspelled, path_of
from star_import.steps import Steps
from star_import.tags import EDGE, Reading, Sheet, sheets
from star_import.text import Line
from star_import.trajectories import Trajectories

CRUISE: Final = 0.5  # m/s, for trajectories: default speed limit of STAR's missions
LOW: Final = 0.2  # m, the lowest for trajectories, whose z often descends below the take-off height
FENCE: Final = "fence"  # location of the remark about it
MARGIN: Final = 1.0  # m, of the fence around all positions in the files
WIDE: Final = 3.0  # m, the same around agents that fly trajectories, of unknown extent
FARTHEST: Final = 1000.0 - WIDE  # m, of a position along an axis: a fence reaches to 1000
ABOVE: Final = 0.2  # m, of the fence above the greatest height and the foot of each obstacle
CLEARANCE: Final = 0.2  # m, of planner `visibility`: nearer to it an obstacle is virtual


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """Options of the command line.

    Attributes:
        name: Name of the mission; None takes that of a file.
        agents: ``NAME=X,Y`` each.
        fence: None fits it around everything.
        edge: Edge of tags, m; None takes that of a file or the original's.
        corners: Whether positions of tags are those of their corners; None takes what the file
            has for flights as executed, and their centers otherwise.
        target_positions: Positions of targets that have none, m.
        new_target: How a position is given to a target, with ``{}`` for its number.
        virtual: Names of obstacles that are virtual in any case, or ``all``.
        solid: Names of obstacles that are not virtual in any case, or ``all``.
        speed: Speed limit, m/s.
        acceleration: Acceleration limit, m/s².
        trajectories: How they are flown.
        as_executed: Whether to reproduce what the original did where that differs from the intent.
        direct: Whether the files are flown as they are; trajectories stay where they are then.
    """

    name: str | None = None
    agents: Sequence[str] = ()
    fence: Room | None = None
    edge: float | None = None
    corners: bool | None = None
    target_positions: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    new_target: str = "--target {}=X,Y"
    virtual: Collection[str] = ()
    solid: Collection[str] = ()
    speed: float | None = None
    acceleration: float | None = None
    trajectories: Trajectories = field(default_factory=Trajectories)
    as_executed: bool = False
    direct: bool = False


def assemble(
    sources: Sources, options: ImportOptions, log: ImportLog, registry: Registry
) -> OutputFiles:
    """Return the output files of an import.

    Raises:
        InputError: They cannot be imported; lists every reason.
    """
    if sources.broken:
        raise sources.broken
    swarm = _swarm(sources, options, log)
    numbers, room = config(sources.config, log), sources.environment
    built = walls(room, log, flat=numbers.expansion <= 1) if room else []
    corner = options.as_executed and not numbers.centred
    reading = Reading(
        edge=options.edge or _edge(sources, log),
        corners=corner if options.corners is None else options.corners,
        target_positions=options.target_positions,
        new_target=options.new_target,
    )
    printed = sheets(room, reading, log) if room else []
    commands: list[Record] = []
    if sources.mission:
        with log.collected():
            commands = records(sources.mission, [robot.name for robot in swarm], log)
    cameras = _calibrations(sources, log)
    measured = capture(sources.capture, swarm, log)
    received = beacons(sources.stations, sources.anchors, log)
    _check_positions(built, printed, swarm, commands, received, log)
    flown = options.trajectories.flown(sources, swarm, log, direct=options.direct)
    log.raise_problems()
    _log_sources(sources, log)
    points = corners(built, printed) + [robot.start[:2] for robot in swarm]
    points += _reached(commands, numbers, len(swarm))
    if received and not points:
        fence = options.fence or _between(received, log)
    else:
        margin = WIDE if flown.agents else MARGIN
        top = max(TOP, numbers.heights[1] + ABOVE, *(wall.height[0] + ABOVE for wall in built))
        fence = options.fence or around(points or [(0.0, 0.0)], margin, top)
    name = _named(options.name or sources.paths[0].stem)
    room_name = f"{name}-room" if swarm else name
    world = _named(path_of(sources.environment).stem if sources.environment else room_name)
    exact = options.as_executed or _crowded(swarm, commands, numbers)
    output = OutputFiles(
        made_of=", ".join(path.name for path in sources.paths),
        mission=f"{name}.yaml" if swarm else None,
        world=f"worlds/{world}.yaml",
        room=fence,
        walls=built,
        sheets=printed,
        beacons=received,
        virtual=_virtual(built, printed, options, log, exact=exact),
        copies=flown.copies,
        written=flown.lines,
    )
    if not swarm:
        return output
    speed = options.speed or (numbers.speed if sources.mission else CRUISE)
    frame = Frame(
        name=name,
        made_of=output.made_of,
        world=output.world,
        speed=max(numbers.climb, speed),
        acceleration=options.acceleration,
        height=numbers.heights if sources.mission else (LOW, numbers.heights[1]),
        exact=exact,
        zone=numbers.zone,
        planner=_planner(built, options, numbers, sources, log),
        tags=bool(printed),
        landmarks=any(sheet.kind == "landmarks" for sheet in printed),
        cameras=cameras,
        pitch_deg=numbers.pitch_deg if sources.config else None,
        capture=measured,
        onboard="" if measured else system(received, log),
        reactions=_reactions(printed if commands else [], numbers, speed),
        numbers=_section(sources.config) if sources.config else "",
    )
    _log_choices(frame, sources, swarm, options, fence, log)
    steps: list[Line] = []
    if sources.mission:
        names = [robot.name for robot in swarm]
        writer = Steps(names, numbers, speed, log, as_executed=options.as_executed)
        steps = writer.write(commands)
    if flown.agents or not sources.mission:
        steps += options.trajectories.steps(flown, sources, log)
    output = replace(output, steps=mission_lines(frame, swarm, steps, log))
    return replace(output, virtual=output.virtual | _too_near(output, options, registry, log))


def log_fence(fence: Room, log: ImportLog) -> None:
    """Log the fence that is in no file."""
    log.assumed(FENCE, f"from {show(fence.low)} to {show(fence.high)} m, around everything")


def _crowded(swarm: Sequence[Robot], commands: Sequence[Record], numbers: Config) -> bool:
    """Return whether a mission leads agents nearer to each other than drift permits.

    Several that are sent to one goal keep twice the protected zone.
    """
    together = any(
        record.task.startswith("goto") and len(record.agents or swarm) > 1 for record in commands
    )
    return together or (bool(commands) and nearest_starts(swarm) < 2 * numbers.zone)


def _virtual(
    built: Sequence[Wall],
    printed: Sequence[Sheet],
    options: ImportOptions,
    log: ImportLog,
    *,
    exact: bool,
) -> frozenset[str]:
    """Return the walls that are virtual: chosen ones, those that hold tags, or all if `exact`."""
    virtual = {wall.name for wall in built if {wall.name, "all"} & {*options.virtual}}
    rest = [wall for wall in built if wall.name not in virtual and not _is_solid(wall, options)]
    for wall in rest:
        hidden = [sheet for sheet in printed if any(has_inside(wall, c) for c in sheet.centres)]
        if exact or hidden:
            virtual.add(wall.name)
            why = f"since {hidden[0].name} is in it" if hidden else "as all are in the original"
            text = "the planner leads around it, and nothing brakes before it"
            log.changed(wall.location, f"is virtual, {why}: {text}", wall.name)
    return frozenset(virtual)


def _is_solid(wall: Wall, options: ImportOptions) -> bool:
    return bool({wall.name, "all"} & {*options.solid})


def _reactions(printed: Sequence[Sheet], numbers: Config, speed: float) -> list[Line]:
    """Return the lines of the reactions to targets."""
    targets = [sheet for sheet in printed if sheet.kind == "targets"]
    return [
        line
        for target in targets
        for line in reaction(target, numbers.sight, numbers.height, speed)
    ]


def _too_near(
    output: OutputFiles, options: ImportOptions, registry: Registry, log: ImportLog
) -> set[str]:
    """Return names of the walls that agents cannot keep clear of, and log why.

    The steps of the mission, as they are flown if every wall is virtual, say where agents are.
    """
    rest = [
        wall
        for wall in output.walls
        if wall.name not in output.virtual and not _is_solid(wall, options)
    ]
    if not rest:
        return set()
    every = frozenset(wall.name for wall in output.walls)
    with replace(output, virtual=every).staged(Path(output.mission or "")) as staged:
        mission = load(staged, registry)
    scene, names = mission.scene, set[str]()
    floor = scene.world.fence.low[2]
    points = [(f"{agent.name} starts", *agent.start) for agent in scene.agents]
    for action in actions(mission.all_steps):
        spec = registry.find("task", action.verb).offer
        if spec.goals is not None:
            goals = spec.goals(scene, action.rows, **action.options)
            points += [(f"{action.verb} leads", *goal.position) for goal in goals]
    highest = max(z for *_, z in points)
    for wall in rest:
        solid = wall.solid
        for what, x, y, z in points:
            away = solid.distance((x, y, floor), highest if z <= floor else z)
            if away < CLEARANCE:
                distance = f"{away:.2f} m from it" if away else "in it"
                text = f"is virtual, since {what} {distance}, nearer than {CLEARANCE} m"
                log.changed(wall.location, text, wall.name)
                names.add(wall.name)
                break
    return names


def _reached(
    commands: Sequence[Record], numbers: Config, count: int
) -> Iterator[tuple[float, float]]:
    """Yield corners around the positions to which records lead agents, m."""
    for record in commands:
        if record.task.startswith("goto"):
            reach = 2 * numbers.zone * (math.ceil(math.sqrt(len(record.agents) or count)) - 1)
            x, y, _ = record.point
            yield from ((x - reach, y - reach), (x + reach, y + reach))


def _check_positions(
    built: Sequence[Wall],
    printed: Sequence[Sheet],
    swarm: Sequence[Robot],
    commands: Sequence[Record],
    received: Sequence[Beacon],
    log: ImportLog,
) -> None:
    """Add positions that are too far away to the problems of `log`."""
    points_by_location = [(wall.location, corners([wall], [])) for wall in built]
    points_by_location += [(sheet.location, corners([], [sheet])) for sheet in printed]
    points_by_location += [(robot.location, [robot.start[:2]]) for robot in swarm]
    points_by_location += [(beacon.location, [beacon.position[:2]]) for beacon in received]
    points_by_location += [
        (record.location, [record.point[:2]])
        for record in commands
        if record.task.startswith("goto")
    ]
    for location, points in points_by_location:
        if any(abs(value) > FARTHEST for point in points for value in point):
            log.problems.append(
                f"{location}: a position is more than {FARTHEST:g} m from the origin"
            )


def _between(received: Sequence[Beacon], log: ImportLog) -> Room:
    """Return the room between base stations and anchors.

    Raises:
        InputError: They span none.
    """
    room = around([beacon.position for beacon in received], 0.0)
    where = received[0].location
    if min(b - a for a, b in zip(room.low[:2], room.high[:2], strict=True)) < MARGIN:
        text = f"{where}: these span no room; give its fence by --fence X Y Z X2 Y2 Z2"
        raise InputError(text, "missing-option")
    log.assumed(where, f"the fence is from {show(room.low)} to {show(room.high)} m, between them")
    return room


def _swarm(sources: Sources, options: ImportOptions, log: ImportLog) -> list[Robot]:
    """Return all agents named by a file or the command line."""
    agents = command_line_agents(options.agents, log.new_agent.partition("{}")[0])
    if sources.robots:
        with log.collected():
            agents = [*robots(sources.robots, sources.types, log), *agents]
    names = [robot.name for robot in agents]
    for robot in agents[len(agents) - len(options.agents) :]:
        if names.count(robot.name) > 1:
            log.problems.append(f"{robot.location}: another agent is named {robot.name!r} too")
    if not agents and not log.problems and (sources.mission or sources.trajectories):
        first = path_of(sources.mission) if sources.mission else sources.trajectories[0]
        log.problems.append(
            f"{first}: has no positions of agents; give crazyflies.yaml too, or "
            f"{log.new_agent.format('NAME')} for each"
        )
        log.problems += [": ".join(near) for path in sources.others if (near := _misspelled(path))]
    return agents


def _calibrations(sources: Sources, log: ImportLog) -> list[Calibration]:
    cameras = []
    for file in sources.calibrations:
        with log.collected():
            cameras.append(calibration(path_of(file), file, log))
    return cameras


def _log_sources(sources: Sources, log: ImportLog) -> None:
    """Log what of the files has no effect at all."""
    if sources.config and not sources.environment:
        chosen = sources.config.map().get("environment_file")
        if chosen is not None and chosen.data:
            text = "this environment is not among the files; the mission is flown in none"
            log.changed(chosen.begins_at, text)
    if sources.server:
        text = "options of Crazyswarm2's server; STAR's transports and simulator have their own"
        log.ignored(sources.server.begins_at, text)
    if sources.tags:
        if (family := sources.tags.map().get("family")) is not None and str(family.data) != "36h11":
            log.changed(family.begins_at, "tags are of the family 36h11, as in the original")
        why = "is an option of another detector"
        log.ignore_keys(sources.tags, {"family", "size"}, why=why)
    for path in sources.partly:
        text = f"only {MOST} of its files were looked at; name files or folders in it"
        log.changed(str(path), text)
    for path in sources.others:
        if near := _misspelled(path):
            log.changed(*near)
            continue
        log.ignored(str(path.parent), "no files of the original STAR or Crazyswarm2", path.name)


def _misspelled(path: Path) -> tuple[str, str] | None:
    """Return where a file of no known kind has a key similar to that of one, and a message."""
    if (near := misspelled(path)) is None:
        return None
    line, key, meant = near
    text = f"is not imported: unknown key {key!r}; did you mean {meant!r}?"
    return f"{path}:{line}:1", text


def _log_choices(
    frame: Frame,
    sources: Sources,
    swarm: Sequence[Robot],
    options: ImportOptions,
    fence: Room,
    log: ImportLog,
) -> None:
    """Log numbers that are in no file, and differences that apply to every import."""
    if options.fence is None:
        log_fence(fence, log)
    low, high = frame.height
    if not sources.config:
        log.assumed(
            "limits",
            f"speed {show(frame.speed)} m/s, heights {show(low)} to {show(high)} m: no config.yaml",
        )
    if frame.exact:
        why = "agents start, or hover at one goal, too near to each other for drifting positions"
        log.changed(
            "limits",
            f"{'as executed' if options.as_executed else why}: positions are treated as exact "
            "(uncertainty_margin 0), and nothing warns of their drift",
        )
    if (used := positioning(swarm)) and not frame.onboard:
        localizer = "apriltag" if frame.landmarks else "flow"
        log.changed(
            swarm[0].location,
            f"the swarm was localized by {used}; it is flown by `{localizer}`, which needs a "
            "Flow deck on each drone; with the file of its base stations or anchors it is flown "
            "by `onboard`",
        )
    if sources.mission:
        log.assumed(
            sources.mission.mark.source, "every step has a timeout, the original's take-off only"
        )
    if frame.reactions and sources.environment:
        log.assumed(
            sources.environment.mark.source,
            "the first agent that comes near a target that was found flies to it and lands",
        )


def _planner(
    built: Sequence[Wall],
    options: ImportOptions,
    numbers: Config,
    sources: Sources,
    log: ImportLog,
) -> str:
    turn = f", yaw_rate_deg: {show(numbers.turn * numbers.rate)}" if sources.mission else ""
    if not built:
        return f"{{use: straight{turn}}}" if turn else "straight"
    if options.as_executed:
        log.assumed("planner", "keeps no distance from obstacles, as executed")
        return f"{{use: visibility, clearance: 0{turn}}}"
    where = sources.environment.begins_at if sources.environment else "planner"
    text = f"the planner keeps {CLEARANCE} m from obstacles where it can, the original none"
    log.changed(where, text)
    return f"{{use: visibility{turn}}}" if turn else "visibility"


def _edge(sources: Sources, log: ImportLog) -> float:
    """Return the edge of the original's tags, m."""
    if sources.tags and (size := sources.tags.map().get("size")) is not None:
        with log.collected():
            if (edge := size.number()) > 0:
                return edge
            raise size.wrong(f"{edge:g}, expected a number more than 0")
    return EDGE


def _section(numbers: Value) -> str:
    """Return the location of a configuration's numbers of flights."""
    return numbers.map().get("trajectory_parameters", numbers).begins_at


def _named(text: str) -> str:
    """Return the valid mission name most similar to `text`."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-_")[:64]
    if not name:
        raise InputError([f"{text!r} has no letter to form a name; give --name"])
    return name
