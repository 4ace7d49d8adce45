"""Assembles the imported data into a mission and its world."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from star_core import InputError
from star_import.config import Config, config
from star_import.firmware import common_parameters
from star_import.import_log import ImportLog, show
from star_import.mission_text import Frame, mission_lines
from star_import.obstacles import Wall, inside, walls
from star_import.output_files import OutputFiles, Room, around, corners, world_lines
from star_import.records import Record, records
from star_import.robots import Robot, command_line_agents, positioning, robots
from star_import.sources import Sources
from star_import.steps import Steps
from star_import.tags import EDGE, Reading, Sheet, sheets
from star_import.text import Line, word

CRUISE: Final = 0.5  # m/s, for trajectories: default speed limit of STAR's missions
LOW: Final = 0.2  # m, the lowest for trajectories, whose z often descends below the take-off height
TRAJECTORY_HEIGHT: Final = 1.0  # m, take-off height of Crazyswarm2's examples
MARGIN: Final = 1.0  # m, of the fence around all positions in the files
FARTHEST: Final = 1000.0  # m, of a position along an axis
WIDE: Final = 3.0  # m, the same around agents that fly trajectories, of unknown extent


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """Options of the command line.

    Attributes:
        name: Name of the mission; None takes that of a file.
        agents: ``NAME=X,Y`` each.
        fence: None fits it around everything.
        edge: Edge of tags, m; None takes that of a file or the original's.
        corners: Whether positions of tags are those of their corners.
        target_positions: Positions of targets that have none, m.
        speed: Flight speed, m/s.
        timescale: Factor by which trajectories are stretched.
        as_executed: Whether to reproduce what the original did where that differs from the intent.
        direct: Whether the files are flown as they are; tags that would overlap are smaller then,
            and trajectories stay where they are.
    """

    name: str | None = None
    agents: Sequence[str] = ()
    fence: Room | None = None
    edge: float | None = None
    corners: bool = False
    target_positions: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    speed: float | None = None
    timescale: float = 1.0
    as_executed: bool = False
    direct: bool = False


def assemble(sources: Sources, options: ImportOptions, log: ImportLog) -> OutputFiles:
    """Return the output files of an import.

    Raises:
        InputError: They cannot be imported; lists every reason.
    """
    swarm = _swarm(sources, options, log)
    numbers = config(sources.config[1], log) if sources.config else Config()
    built = walls(sources.environment[1], log) if sources.environment else []
    edge = options.edge or _edge(sources, log)
    reading = Reading(edge, options.corners, options.target_positions, options.direct)
    printed = sheets(sources.environment[1], reading, log) if sources.environment else []
    printed = [sheet for sheet in printed if not _inside(sheet, built, log)]
    commands: list[Record] = []
    if sources.mission:
        with log.collected():
            commands = records(sources.mission[1], [robot.name for robot in swarm], log)
    parameters, located_by = _hardware(sources, swarm, log)
    _check_positions(built, printed, swarm, commands, log)
    log.raise_problems()
    _log_differences(sources, log, as_executed=options.as_executed, built=built)
    points = corners(built, printed) + [robot.start[:2] for robot in swarm]
    points += [record.point[:2] for record in commands if record.task.startswith("goto")]
    room = options.fence or around(points or [(0.0, 0.0)], WIDE if sources.trajectories else MARGIN)
    if options.fence is None:
        log.add("fence", f"not in the files; from {show(room.low)} to {show(room.high)} m")
    made_of = ", ".join(path.name for path in sources.paths)
    name = _named(options.name or sources.paths[0].stem)
    world = _named(sources.environment[0].stem if sources.environment else f"{name}-room")
    world_file = f"worlds/{world}.yaml"
    lines = {world_file: world_lines(world, made_of, room, built, printed)}
    if not swarm:
        return OutputFiles(lines, None, world_file, room)
    speed = options.speed or (numbers.speed if sources.mission else CRUISE)
    frame = Frame(
        name=name,
        made_of=made_of,
        world=world_file,
        speed=max(numbers.climb, speed),
        height=numbers.heights if sources.mission else (LOW, numbers.heights[1]),
        zone=numbers.zone,
        planner=_planner(built, options, log),
        landmarks=any(sheet.kind == "landmarks" for sheet in printed),
        positioning=located_by,
        parameters=parameters,
    )
    log.add(name, _chosen(frame, commands, numbers, speed, _origin(sources)))
    copies = {
        path.name if options.direct else f"paths/{path.name}": path for path in sources.trajectories
    }
    steps: list[Line] = []
    if sources.mission:
        writer = Steps(
            [robot.name for robot in swarm], numbers, speed, log, as_executed=options.as_executed
        )
        steps = writer.write(commands)
    if sources.trajectories or not sources.mission:
        steps += _trajectories(sources, copies, options, log)
    lines[f"{name}.yaml"] = mission_lines(frame, swarm, steps, log)
    return OutputFiles(lines, f"{name}.yaml", world_file, room, copies)


def _check_positions(
    built: Sequence[Wall],
    printed: Sequence[Sheet],
    swarm: Sequence[Robot],
    commands: Sequence[Record],
    log: ImportLog,
) -> None:
    """Add positions that are too far away to the problems of `log`."""
    points_by_location = [(wall.location, corners([wall], [])) for wall in built]
    points_by_location += [(sheet.location, corners([], [sheet])) for sheet in printed]
    points_by_location += [(robot.location, [robot.start[:2]]) for robot in swarm]
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


def _swarm(sources: Sources, options: ImportOptions, log: ImportLog) -> list[Robot]:
    """Return all agents named by a file or the command line."""
    agents = command_line_agents(options.agents, log.new_agent.partition("{}")[0])
    if sources.robots:
        with log.collected():
            agents = [*robots(sources.robots[1], log), *agents]
    names = [robot.name for robot in agents]
    for robot in agents[len(agents) - len(options.agents) :]:
        if names.count(robot.name) > 1:
            log.problems.append(f"{robot.location}: another agent is named {robot.name!r} too")
    if not agents and not log.problems and (sources.mission or sources.trajectories):
        first = sources.mission[0] if sources.mission else sources.trajectories[0]
        log.problems.append(
            f"{first}: has no positions of agents; give crazyflies.yaml too, or "
            f"{log.new_agent.format('NAME')} for each"
        )
    return agents


def _hardware(
    sources: Sources, swarm: Sequence[Robot], log: ImportLog
) -> tuple[dict[str, float], str]:
    """Firmware parameters common to all robots, and the system that localized the swarm."""
    if not sources.robots:
        return {}, ""
    file, parameters, system = sources.robots[1], {}, ""
    listed = file.need("robots").map()
    names = [robot.name for robot in swarm if robot.name in listed]
    with log.collected():
        parameters = common_parameters(file, names, log)
        system = positioning(file, names, list(parameters))
    return parameters, system


def _log_differences(
    sources: Sources, log: ImportLog, *, as_executed: bool, built: Sequence[Wall]
) -> None:
    """Log differences that apply to every import."""
    if sources.mission:
        where = str(sources.mission[0])
        log.add(where, "the original has timeouts only at take-off; here every step has one")
        if built and not as_executed:
            log.add(where, "the planner keeps 0.2 m from obstacles, the original no distance")


def _origin(sources: Sources) -> str:
    return f"of {sources.config[0].name}" if sources.config else "not in the files"


def _chosen(
    frame: Frame, commands: Sequence[Record], config: Config, speed: float, origin: str
) -> str:
    """List numbers of the mission that are the original's defaults or of its configuration."""
    low, high = frame.height
    described = [
        f"limits.speed {show(frame.speed)} m/s",
        f"limits.height {show(low)} to {show(high)} m",
    ]
    if any(record.task.startswith("goto") for record in commands):
        described += [f"of goto: speed {show(speed)} m/s", f"within {show(config.reached)} m"]
        described += [f"spacing {show(2 * config.zone)} m where several fly to one position"]
    return f"numbers {origin}: {', '.join(described)}"


def _planner(built: Sequence[Wall], options: ImportOptions, log: ImportLog) -> str:
    if not built:
        return "straight"
    if options.as_executed:
        log.add("planner", "keeps no distance from obstacles, as executed")
        return "{use: visibility, clearance: 0}"
    return "visibility"


def _trajectories(
    sources: Sources, copies: Mapping[str, Path], options: ImportOptions, log: ImportLog
) -> Iterator[Line]:
    """Yield the steps of Crazyswarm2's trajectories, with a take-off and a landing."""
    if sources.mission:
        log.add(str(sources.mission[0]), "trajectories are flown after its commands")
    log.add("mission", f"a take-off to {TRAJECTORY_HEIGHT:g} m and a landing, which are not "
              "in the files, are added")  # fmt: skip
    yield Line(f"  - takeoff: {{height: {TRAJECTORY_HEIGHT:g}}}")
    slow = f", timescale: {show(options.timescale)}" if options.timescale != 1.0 else ""
    for name, path in copies.items():
        log.add(
            str(path),
            "durations in s, x, y and z in m, yaw in rad; flown by all, each from its position",
        )
        yield Line(f"  - follow: {{file: {word(name)}, format: poly7{slow}}}", str(path))
    yield Line("  - land: {}")


def _edge(sources: Sources, log: ImportLog) -> float:
    """Return the edge of the original's tags, m."""
    if sources.tags and (size := sources.tags[1].map().get("size")) is not None:
        with log.collected():
            if (edge := size.number()) > 0:
                return edge
            raise size.wrong(f"{edge:g}, expected a number more than 0")
    return EDGE


def _inside(sheet: Sheet, built: Sequence[Wall], log: ImportLog) -> bool:
    """Return whether a tag of a sheet is inside a wall, which is logged."""
    for wall in built:
        if any(inside(wall, centre) for centre in sheet.centres):
            tags = ", ".join(map(str, sheet.numbers))
            log.warning(sheet.location, f"tags {tags} are inside {wall.name}; ignored")
            return True
    return False


def _named(text: str) -> str:
    """Return the valid mission name most similar to `text`."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", text).strip("-_")[:64]
    if not name:
        raise InputError([f"{text!r} has no letter to form a name; give --name"])
    return name
