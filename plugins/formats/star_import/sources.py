"""The input files of an import, sorted by content."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from star_core import InputError, Registry
from star_core.formats import Value, format_function

SORTS: Final[Mapping[str, frozenset[str]]] = {
    "mission": frozenset({"command_sequence"}),
    "environment": frozenset({"environment", "april_tags"}),
    "robots": frozenset({"robots"}),
    "config": frozenset({"environment_file", "trajectory_parameters"}),
    "tags": frozenset({"family"}),
}
"""Kinds of files, and the keys at the top by which they are recognized."""
FLOWN: Final = {"mission", "environment", "robots"}
OWN: Final = frozenset({"star", "mission", "swarm", "world", "agents", "drones"})
"""Keys of STAR's own files."""
KEY: Final = re.compile(rb"^([a-z_0-9]+)[ \t]*:", re.MULTILINE)
LONGEST: Final = 1_000_000  # bytes of a file, the most that is read
DEEPEST: Final = 4  # folders below the one that is named
MOST: Final = 1000  # files in a folder that are looked at


@dataclass(slots=True)
class Sources:
    """Input files by kind, if present.

    Attributes:
        mission: The original STAR's list of commands, and its path.
        environment: Its obstacles and tags, and their path.
        robots: Crazyswarm2's robots, and their path.
        config: The original's parameters, and their path.
        tags: The configuration of its detector of tags, and its path.
        trajectories: Paths of polynomial trajectories.
    """

    mission: tuple[Path, Value] | None = None
    environment: tuple[Path, Value] | None = None
    robots: tuple[Path, Value] | None = None
    config: tuple[Path, Value] | None = None
    tags: tuple[Path, Value] | None = None
    trajectories: list[Path] = field(default_factory=list)

    @property
    def paths(self) -> list[Path]:
        """The files, each once, that with content to fly first."""
        files = (self.mission, self.environment, self.robots, self.config, self.tags)
        listed = [source[0] for source in files if source] + self.trajectories
        return list(dict.fromkeys(listed))


def sorted_out(paths: Sequence[Path], registry: Registry) -> Sources:
    """Read files and sort them by content.

    Raises:
        InputError: One cannot be read, has unknown content, or the same kind as another.
    """
    sources = Sources()
    problems: list[str] = []
    for path in paths:
        try:
            _add(sources, path, registry)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return sources


def recognizes(path: Path) -> bool:
    """Return whether a file is in this format, or a folder has a mission or robots of it."""
    if not path.is_dir():
        return bool(sorts_of(path) & FLOWN)
    if (path / "manifest.json").exists():  # a record
        return False
    return any(sorts_of(file) & {"mission", "robots"} for file in files_in(path))


def sorts_of(path: Path) -> set[str]:
    """Return what kinds of files one may be, by the words at the beginnings of its lines."""
    if path.suffix not in {".yaml", ".yml"} or not path.is_file():
        return set()
    try:
        with path.open("rb") as stream:
            keys = {key.decode() for key in KEY.findall(stream.read(LONGEST))}
    except OSError:
        return set()
    sorts = set() if keys & OWN else {sort for sort, marks in SORTS.items() if keys & marks}
    return {"config"} if "config" in sorts else sorts


def files_in(folder: Path) -> Iterator[Path]:
    """Yield the files in a folder and in those below it, up to a depth, hidden ones left out."""
    count = 0
    for parent, folders, files in os.walk(folder):
        above = Path(parent)
        deep = len(above.relative_to(folder).parts) >= DEEPEST
        folders[:] = [] if deep else sorted(name for name in folders if not name.startswith("."))
        for file in sorted(files):
            if (count := count + 1) > MOST:
                return
            yield above / file


def _add(sources: Sources, path: Path, registry: Registry) -> None:
    if path.suffix == ".csv":
        if not path.is_file():
            raise InputError([f"{path}: no such file"])
        if path.name in [other.name for other in sources.trajectories]:
            raise InputError([f"{path}: another file is named {path.name!r} too; rename one"])
        sources.trajectories.append(path)
        return
    value: Value = format_function("values", registry)(path)
    keys = value.map().keys()
    sorts = [sort for sort, marks in SORTS.items() if keys & marks]
    if "config" in sorts:  # its list of commands is a default that no flight has
        sorts = ["config"]
    for sort in sorts:
        if before := getattr(sources, sort):
            raise InputError([f"{path}: same kind of file as {before[0]}; give one of them"])
        setattr(sources, sort, (path, value))
    if not sorts:
        raise value.wrong(
            "contains none of 'command_sequence', 'environment', 'april_tags' (the original STAR) "
            "and 'robots' (Crazyswarm2)"
        )
