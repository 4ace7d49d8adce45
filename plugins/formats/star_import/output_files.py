"""The files of an import: world, mission and steps, checked before any of them is written."""

from __future__ import annotations

import math
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from star_core import InputError
from star_import.beacons import Beacon
from star_import.import_log import show
from star_import.obstacles import Wall
from star_import.tags import Sheet
from star_import.text import Line, traced, whole, word

PROBE = "probe.yaml"  # a mission used to check a world that was imported without one


@dataclass(frozen=True, slots=True)
class OutputFiles:
    """The files to be written.

    Attributes:
        made_of: Names of the files that they were imported from.
        mission: Path of the mission in the folder; None if there is a world only.
        world: Path of the world.
        room: Its fence.
        walls: Its obstacles.
        sheets: Its tags.
        beacons: Its base stations and anchors.
        virtual: Names of the obstacles that are virtual.
        steps: Lines of the mission.
        copies: Files to be copied, by their path in the folder.
        written: Lines of further files, by the same.
        origin_of_all: Location of lines that were not imported; empty for none.
    """

    made_of: str
    mission: str | None
    world: str
    room: Room
    walls: Sequence[Wall]
    sheets: Sequence[Sheet]
    beacons: Sequence[Beacon]
    virtual: frozenset[str]
    steps: Sequence[Line] = ()
    copies: Mapping[str, Path] = field(default_factory=dict)
    written: Mapping[str, Sequence[Line]] = field(default_factory=dict)
    origin_of_all: str = ""

    @property
    def lines(self) -> dict[str, Sequence[Line]]:
        """Lines of each file, by its path in the folder."""
        files = {self.world: self._world_lines(), **self.written}
        if self.mission:
            files[self.mission] = self.steps
        return {
            name: [Line(line.text, line.origin or self.origin_of_all) for line in lines]
            for name, lines in files.items()
        }

    @contextmanager
    def staged(self, folder: Path) -> Iterator[Path]:
        """Write the files to a temporary folder, and yield the path of the mission there.

        It is a probe if there is a world only. Problems that are raised inside the context have the
        locations that the files were imported from.

        Args:
            folder: Folder of the files in the messages.
        """
        with tempfile.TemporaryDirectory() as name:
            self.put(Path(name))
            mission = Path(name, self.mission or PROBE)
            if not self.mission:
                mission.write_text(self._probe(), encoding="utf-8")
            try:
                yield mission
            except InputError as error:
                problems = [self.relocated(p, Path(name), folder) for p in error.problems]
                problems = [p for p in problems if not p.startswith(str(Path(name, PROBE)))]
                if problems:
                    raise InputError(list(dict.fromkeys(problems))) from None

    def origin(self, location: str, staged: Path) -> str:
        """Return where a location ``file:line:col`` of a staged file was imported from."""
        file, line, _ = ("::" + location.removeprefix(f"{staged}/")).rsplit(":", 2)
        lines = self.lines.get(file.removeprefix("::"))
        return lines[int(line) - 1].origin if lines else location

    def put(self, folder: Path) -> None:
        """Write the files into a folder, over others if necessary."""
        for name, lines in self.lines.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(whole(lines), encoding="utf-8")
        for name, source in self.copies.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, folder / name)

    def _world_lines(self) -> list[Line]:
        lines = [
            Line(f"# Imported by `star import` from {self.made_of}."),
            Line("star: 1"),
            Line(f"name: {word(Path(self.world).stem)}"),
            Line(f"fence: {{low: {show(self.room.low)}, high: {show(self.room.high)}}}"),
        ]
        if self.walls:
            lines.append(Line("obstacles:"))
            lines += [wall.line(virtual=wall.name in self.virtual) for wall in self.walls]
        for kind in ("landmarks", "targets", "base_stations", "anchors"):
            listed: tuple[Sheet | Beacon, ...] = (*self.sheets, *self.beacons)
            of_kind = [item.line() for item in listed if item.kind == kind]
            lines += [Line(f"{kind}:"), *of_kind] if of_kind else []
        return lines

    def relocated(self, problem: str, staged: Path, folder: Path) -> str:
        """Return a problem of a staged file with the location the file was imported from."""
        for name, lines in self.lines.items():
            problem = traced(problem, str(staged / name), str(folder / name), lines)
        for name, source in self.copies.items():
            problem = re.sub(rf"(?<![\w/]){re.escape(name)}(?=:)", str(source), problem)
        return problem

    def _probe(self) -> str:
        start = [self.room.low[0] + 0.1, self.room.low[1] + 0.1, self.room.low[2]]
        return (
            f"star: 1\nname: probe\nworld: {self.world}\nswarm: {{a: {{start: {show(start)}}}}}\n"
            "transport: sim\nlocalizer: flow\nplanner: straight\navoider: none\n"
            "mission: [hold: {}]\n"
        )


def write(outputs: Sequence[OutputFiles], folder: Path, *, force: bool) -> list[Path]:
    """Write the files of some missions into a folder and return them.

    Raises:
        InputError: A file exists and `force` is not set, or a file cannot be written.
    """
    names = dict.fromkeys(name for output in outputs for name in (*output.lines, *output.copies))
    paths = [folder / name for name in names]
    if existing := [path for path in paths if path.exists()]:
        if not force:
            raise InputError([f"{p}: exists already; --force overwrites it" for p in existing])
        for source in (source for output in outputs for source in output.copies.values()):
            if any(path.samefile(source) for path in existing):
                raise InputError([f"{source}: would be overwritten by itself; choose --out"])
    try:
        for output in outputs:
            output.put(folder)
    except OSError as error:
        where = error.filename or folder
        raise InputError([f"{where}: cannot be written: {error.strerror}"]) from error
    return paths


Point = tuple[float, float, float]
TOP = 2.2  # m, lowest top of the fence: slightly above the original's greatest height of 2 m


@dataclass(frozen=True, slots=True)
class Room:
    """The fence: its lower and its upper corner, map frame, m."""

    low: Point
    high: Point


def around(points: Iterable[Sequence[float]], margin: float, top: float = TOP) -> Room:
    """Return a room with a `margin` around points in the plane, m, rounded to 0.1 m."""
    xs, ys = zip(*((p[0], p[1]) for p in points), strict=True)
    west, south = (math.floor((min(values) - margin) * 10) / 10 for values in (xs, ys))
    east, north = (math.ceil((max(values) + margin) * 10) / 10 for values in (xs, ys))
    return Room((west, south, 0.0), (east, north, math.ceil(round(top * 10, 6)) / 10))


def around_all(rooms: Sequence[Room]) -> Room:
    """Return the smallest room that holds some rooms."""
    x, y, z = (min(values) for values in zip(*(room.low for room in rooms), strict=True))
    x2, y2, z2 = (max(values) for values in zip(*(room.high for room in rooms), strict=True))
    return Room((x, y, z), (x2, y2, z2))


def corners(walls: Iterable[Wall], sheets: Iterable[Sheet]) -> list[tuple[float, float]]:
    """Return the outermost points of walls and sheets."""
    points = [centre for sheet in sheets for centre in sheet.centres]
    for wall in walls:
        half = wall.thickness / 2
        points += [(x + side, y + side) for x, y in wall.points for side in (-half, half)]
    return points
