"""The static description of a flight that every plugin receives. Nothing here imports numpy."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from star_core.errors import InputError, shortlist, suggestion
from star_core.world.camera import Camera
from star_core.world.quaternions import Point
from star_core.world.world import World


@dataclass(frozen=True, slots=True)
class Agent:
    """One drone of the swarm.

    Attributes:
        name: In the mission.
        start: Position before take-off, map frame, m.
        yaw: Heading there, rad, anticlockwise from the map's x axis.
        uri: Address of its link; the simulator does not need one.
        camera: Its camera, if it has one.
    """

    name: str
    start: Point
    yaw: float = 0.0
    uri: str | None = None
    camera: Camera | None = None


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of every agent. The core enforces the speed, and brakes for the separation.

    Attributes:
        speed: Greatest speed, m/s.
        acceleration: Greatest acceleration, m/s².
        height: Lowest and highest z to fly at, map frame, m.
        separation: Horizontal distance between the centers of two agents at the same height below
            which neither is steered towards the other, m; 0 switches this off.
        vertical_separation: The same of one above the other, m. In between, the two are semi-axes
            of an ellipsoid.
        uncertainty_margin: Number of standard deviations of its position by which the distances of
            an agent to others, obstacles and fence are enlarged, up to a limit; 0 treats positions
            as exact.
    """

    speed: float = 0.5
    acceleration: float = 2.0
    height: tuple[float, float] = (0.2, 1.8)
    separation: float = 0.2
    vertical_separation: float = 0.6
    uncertainty_margin: float = 2.0


@dataclass(frozen=True, slots=True)
class Scene:
    """The static description of a flight.

    Attributes:
        agents: The drone of each row; row *i* is the same agent in every table of the mission.
        period: Time from one tick to the next, s.
        world: Geofence and obstacles.
        limits: Speed, acceleration and heights.
        seed: Root of every random number: a plugin draws from
            ``numpy.random.default_rng([scene.seed, its own constant])`` and from nothing else.
        realtime: Whether mission time advances by itself, so that no plugin may wait.
        exact_odometry: Whether the agents start where they are expected and their odometry has no
            error, as in a simulation without noise.
        heights_above_surface: Whether on-board estimators may take what is below for the floor.
        flow_deck: Whether the agents carry Flow decks, which measure their heights and velocities.
        detects_tags: Whether cameras send corners of tags, `Telemetry.detections`, not images.
        measures_positions: Whether a positioning system measures positions: `Telemetry.fixes`.
        measurement_errors: Standard deviation of these along each axis, m, and the longest time
            without one of an agent, s; None if that is not known before the flight.
        onboard_system: Positioning system by which the on-board estimators know the map, so that
            they report in the map frame; None if they start at the origin of their odometry, or if
            that is not known before the flight.
        reports_in_map: Whether the localizer takes reports of estimators that know the map.
            Transports then report the variances of their positions.
        folder: The mission's folder; files that a mission names are read from inside it.
        files: The files requested through `file`, by their names in the mission.
        groups: Rows of the agents of each of the mission's groups, by its name, in its order.
    """

    agents: tuple[Agent, ...]
    period: float
    world: World
    limits: Limits = field(default_factory=Limits)
    seed: int = 0
    realtime: bool = False
    exact_odometry: bool = False
    heights_above_surface: bool = True
    flow_deck: bool = True
    detects_tags: bool = False
    measures_positions: bool = False
    measurement_errors: tuple[float, float] | None = None
    onboard_system: str | None = None
    reports_in_map: bool = False
    folder: Path = field(default_factory=Path)
    files: dict[str, Path] = field(default_factory=dict, compare=False, repr=False)
    groups: Mapping[str, tuple[int, ...]] = field(default_factory=dict, hash=False)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the agent in each row."""
        return tuple(agent.name for agent in self.agents)

    @property
    def rows_by_name(self) -> dict[str, tuple[int, ...]]:
        """Rows by the name of an agent or a group, or ``all``."""
        rows = {name: (row,) for row, name in enumerate(self.names)}
        return {**self.groups, **rows, "all": tuple(range(len(rows)))}

    def height_fault(self, height: float) -> str | None:
        """Return why no agent can fly at a height (z in the map, m); None if agents can."""
        low, high = self.limits.height
        if not low <= height <= high:
            return f"{height:g} m is outside the heights to fly at, from {low:g} to {high:g} m"
        low, high = self.world.fence.low[2], self.world.fence.high[2]
        if not low <= height <= high:
            return f"{height:g} m is outside the fence, from {low:g} to {high:g} m"
        return None

    def position_fault(self, position: tuple[float, float, float]) -> str | None:
        """Return why no agent can fly at a position (map frame, m); None if agents can."""
        x, y, z = position
        low, high = self.limits.height
        if not low <= z <= high:
            heights = f"from {low:g} to {high:g} m"
            return f"[{x:g}, {y:g}, {z:g}] is outside the heights to fly at, {heights}"
        return self.world.fault(position)

    def file(self, name: str) -> Path:
        """Return the path of a file that the mission names.

        Raises:
            InputError: It is no file inside the mission's folder.
        """
        self.files[name] = inside(self.folder, name)
        return self.files[name]

    def named(self, rows: Iterable[int]) -> str:
        """Return the names of some rows, of more than ten the first: ``cf1, cf3``."""
        return shortlist(self.agents[row].name for row in rows)

    def label(self, rows: Collection[int]) -> str:
        """Return the names of some rows, their group's name or ``all agents``: the shortest."""
        groups = [name for name, members in self.groups.items() if {*members} == {*rows}]
        every = ["all agents"] if {*rows} == {*range(len(self.agents))} else []
        return min([self.named(rows), *groups, *every], key=len)


def inside(folder: Path, name: str) -> Path:
    """Return the path of a file that a mission names.

    Args:
        folder: The mission's folder.
        name: As the mission writes it, relative to the folder.

    Raises:
        InputError: It is absolute, leaves the folder (links followed), or is no file.
    """
    path = folder / name
    try:
        within = path.resolve().is_relative_to(folder.resolve())
        exists, is_file = path.exists(), path.is_file()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a NUL in the name
        raise InputError(f"{name!r} is no path of a file: {error}", "unreadable-file") from error
    if Path(name).is_absolute():
        relative = path.resolve().relative_to(folder.resolve()) if within else "paths/file.csv"
        text = f"{name!r} is an absolute path; write it from the mission's folder: {relative}"
        raise InputError(text, "file-not-found")
    if not within:
        text = f"{name!r} is outside the mission's folder; name a file inside it"
        raise InputError(text, "file-not-found")
    if is_file:
        return path
    if exists:
        text = f"{name!r} is no file; name a file in the mission's folder"
        raise InputError(text, "unreadable-file")
    if "\\" in name:
        slashes = name.replace("\\", "/")
        raise InputError(f"no file {name!r}; write '/' in paths: {slashes}", "file-not-found")
    beside = [str(Path(name).parent / p.name) for p in path.parent.glob("*") if p.is_file()]
    hint = suggestion(name, beside)
    raise InputError(f"no file {name!r} in the mission's folder{hint}", "file-not-found")
