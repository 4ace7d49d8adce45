"""The files of an import: world, mission and steps, checked before any of them is written."""

from __future__ import annotations

import math
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from star_core import InputError, Registry, load
from star_import.import_log import show
from star_import.obstacles import Wall
from star_import.tags import Sheet
from star_import.text import Line, traced, whole, word

PROBE = "probe.yaml"  # a mission used to check a world that was imported without one


@dataclass(frozen=True, slots=True)
class OutputFiles:
    """The files to be written.

    Attributes:
        lines: Lines of each file, by its path in the folder.
        copies: Files to be copied, by their path in the folder.
        mission: Path of the mission in the folder; None if there is a world only.
        world: Path of the world.
        room: Its fence.
    """

    lines: Mapping[str, Sequence[Line]]
    mission: str | None
    world: str
    room: Room
    copies: Mapping[str, Path] = field(default_factory=dict)

    def check(self, folder: Path) -> None:
        """Check the files as `star check` does, before they are in `folder`.

        Raises:
            InputError: They cannot be flown; each reason has the location it was imported from.
        """
        with self.staged(folder) as staged:
            load(staged, Registry())

    @contextmanager
    def staged(self, folder: Path) -> Iterator[Path]:
        """Write the files to a temporary folder, and yield the path of the mission there.

        It is a probe if there is a world only. Problems that are raised inside the context have the
        locations that the files were imported from.

        Args:
            folder: Folder of the files in the messages.
        """
        with tempfile.TemporaryDirectory() as name:
            self._put(Path(name))
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

    def located(self, origin: str) -> OutputFiles:
        """Return the same files, in which lines that were not imported have a location too."""
        lines = {
            name: [Line(line.text, line.origin or origin) for line in lines]
            for name, lines in self.lines.items()
        }
        return replace(self, lines=lines)

    def origin(self, location: str, staged: Path) -> str:
        """Return where a location ``file:line:col`` of a staged file was imported from."""
        file, line, _ = ("::" + location.removeprefix(f"{staged}/")).rsplit(":", 2)
        lines = self.lines.get(file.removeprefix("::"))
        return lines[int(line) - 1].origin if lines else location

    def write(self, folder: Path, *, force: bool) -> list[Path]:
        """Write the files into a folder and return them.

        Raises:
            InputError: A file exists and `force` is not set, or a file cannot be written.
        """
        paths = [folder / name for name in (*self.lines, *self.copies)]
        if existing := [path for path in paths if path.exists()]:
            if not force:
                raise InputError([f"{p}: exists already; --force overwrites it" for p in existing])
            for source in self.copies.values():
                if any(path.samefile(source) for path in existing):
                    raise InputError([f"{source}: would be overwritten by itself; choose --out"])
        try:
            self._put(folder)
        except OSError as error:
            where = error.filename or folder
            raise InputError([f"{where}: cannot be written: {error.strerror}"]) from error
        return paths

    def _put(self, folder: Path) -> None:
        for name, lines in self.lines.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(whole(lines), encoding="utf-8")
        for name, source in self.copies.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, folder / name)

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


Point = tuple[float, float, float]
TOP = 2.2  # m, default top of the fence: slightly above the original's greatest height of 2 m


@dataclass(frozen=True, slots=True)
class Room:
    """The fence: its lower and its upper corner, map frame, m."""

    low: Point
    high: Point


def around(points: Iterable[Sequence[float]], margin: float) -> Room:
    """Return a room with a `margin` around points in the plane, m, rounded to 0.1 m."""
    xs, ys = zip(*((p[0], p[1]) for p in points), strict=True)
    west, south = (math.floor((min(values) - margin) * 10) / 10 for values in (xs, ys))
    east, north = (math.ceil((max(values) + margin) * 10) / 10 for values in (xs, ys))
    return Room((west, south, 0.0), (east, north, TOP))


def corners(walls: Iterable[Wall], sheets: Iterable[Sheet]) -> list[tuple[float, float]]:
    """Return the outermost points of walls and sheets."""
    points = [centre for sheet in sheets for centre in sheet.centres]
    for wall in walls:
        half = wall.thickness / 2
        points += [(x + side, y + side) for x, y in wall.points for side in (-half, half)]
    return points


def world_lines(
    name: str, made_of: str, room: Room, walls: Sequence[Wall], sheets: Sequence[Sheet]
) -> list[Line]:
    """Return the lines of a world file."""
    lines = [
        Line(f"# Imported by `star import` from {made_of}."),
        Line("star: 1"),
        Line(f"name: {word(name)}"),
        Line(f"fence: {{low: {show(room.low)}, high: {show(room.high)}}}"),
    ]
    if walls:
        lines += [Line("obstacles:"), *(wall.line() for wall in walls)]
    for kind in ("landmarks", "targets"):
        of_kind = [sheet.line() for sheet in sheets if sheet.kind == kind]
        lines += [Line(f"{kind}:"), *of_kind] if of_kind else []
    return lines
