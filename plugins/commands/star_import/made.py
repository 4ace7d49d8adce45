"""The files that an import makes: checked before any of them is written."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from star_core import InputError, Registry, load
from star_import.notes import show
from star_import.text import Line, traced, whole
from star_import.world_text import Room

PROBE = "probe.yaml"  # a mission that flies in a world that came without one


@dataclass(frozen=True, slots=True)
class Made:
    """What is to be written.

    Attributes:
        lines: Of each file, by its path from the folder.
        copies: Files to be copied, by their path from the folder.
        mission: Path of the mission, from the folder; none if there is a world only.
        world: Path of the world.
        room: Its fence.
    """

    lines: Mapping[str, Sequence[Line]]
    mission: str | None
    world: str
    room: Room
    copies: Mapping[str, Path] = field(default_factory=dict)

    def check(self, folder: Path) -> None:
        """Hold the files to what `star check` holds them to, before they are in `folder`.

        Raises:
            InputError: They cannot be flown; each reason stands at the place it was made from.
        """
        with tempfile.TemporaryDirectory() as name:
            staged = Path(name)
            self._put(staged)
            mission = self.mission or PROBE
            if not self.mission:
                (staged / PROBE).write_text(self._probe(), encoding="utf-8")
            try:
                load(staged / mission, Registry())
            except InputError as error:
                problems = [self._told(problem, staged, folder) for problem in error.problems]
                problems = [p for p in problems if not p.startswith(str(staged / PROBE))]
                if problems:
                    raise InputError(list(dict.fromkeys(problems))) from None

    def write(self, folder: Path, *, force: bool) -> list[Path]:
        """Write the files into a folder and return them.

        Raises:
            InputError: One of them is there and `force` is not given, or cannot be written.
        """
        paths = [folder / name for name in (*self.lines, *self.copies)]
        if there := [path for path in paths if path.exists()]:
            if not force:
                raise InputError([f"{p}: is there already; --force writes over it" for p in there])
            for source in self.copies.values():
                if any(path.samefile(source) for path in there):
                    raise InputError([f"{source}: would be written over itself; choose --out"])
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

    def _told(self, problem: str, staged: Path, folder: Path) -> str:
        """A problem of a staged file, at the place of what the file was made from."""
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
