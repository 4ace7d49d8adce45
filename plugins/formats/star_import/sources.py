"""The input files of an import, sorted by content."""

from __future__ import annotations

import os
import re
from codecs import BOM_UTF8
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Final

from star_core import InputError, Registry
from star_core.formats import Value, format_function
from star_import.import_log import SIMILAR

SORTS: Final[Mapping[str, frozenset[str]]] = {
    "mission": frozenset({"command_sequence"}),
    "environment": frozenset({"environment", "april_tags"}),
    "robots": frozenset({"robots", "crazyflies"}),
    "types": frozenset({"crazyflieTypes"}),
    "config": frozenset({"environment_file", "trajectory_parameters", "april_tag_parameters"}),
    "tags": frozenset({"family"}),
    "calibration": frozenset({"camera_matrix"}),
    "capture": frozenset({"/motion_capture_tracking", "motion_capture_tracking"}),
    "server": frozenset({"/crazyflie_server", "crazyflie_server"}),
    "stations": frozenset({"geos"}),
}
"""Kinds of files, and the keys at the top by which they are recognized."""
SINGLE: Final = ("robots", "types", "config", "tags", "capture", "server", "stations", "anchors")
"""Kinds of which a mission has one file at most, its environment apart."""
FLOWN: Final = {"mission", "environment", "robots", "stations", "anchors"}
OWN: Final = frozenset({"star", "mission", "swarm", "world", "agents", "drones"})
"""Keys of STAR's own files."""
KEY: Final = re.compile(rb"""^([ {]*)["']?(/?[A-Za-z_0-9]+)["']?[ \t]*:""", re.MULTILINE)
HEADER: Final = "duration"  # begins Crazyswarm2's trajectories
LONGEST: Final = 1_000_000  # bytes of a file, the most that is read
DEEPEST: Final = 4  # folders below the one that is named
MOST: Final = 1000  # files in a folder that are looked at


@dataclass(frozen=True, slots=True)
class Sources:
    """The files of one mission, if present.

    Attributes:
        mission: The original STAR's list of commands.
        environment: Its obstacles and tags.
        robots: Crazyswarm2's or Crazyswarm's robots.
        types: Crazyswarm's types of robots.
        config: The original's parameters.
        tags: The configuration of its detector of tags.
        capture: The motion-capture system.
        server: Options of Crazyswarm2's server and simulator.
        stations: Geometry of Lighthouse base stations.
        anchors: Positions of Loco anchors.
        calibrations: Cameras.
        trajectories: Paths of polynomial trajectories.
        others: Paths of files that are none of these.
        partly: Folders of which `MOST` files were looked at, the most that are.
        broken: Why the mission cannot be read, if it cannot.
    """

    mission: Value | None = None
    environment: Value | None = None
    robots: Value | None = None
    types: Value | None = None
    config: Value | None = None
    tags: Value | None = None
    capture: Value | None = None
    server: Value | None = None
    stations: Value | None = None
    anchors: Value | None = None
    calibrations: Sequence[Value] = ()
    trajectories: Sequence[Path] = ()
    others: Sequence[Path] = ()
    partly: Sequence[Path] = ()
    broken: InputError | None = None

    @property
    def paths(self) -> list[Path]:
        """The files that are known, each once, that with content to fly first."""
        single = [getattr(self, sort) for sort in ("mission", "environment", *SINGLE)]
        files = map(path_of, filter(None, [*single, *self.calibrations]))
        return list(dict.fromkeys([*files, *self.trajectories]))


def path_of(file: Value) -> Path:
    """Return the path of a file, of which this is the content."""
    return Path(file.mark.source)


@dataclass(slots=True)
class Files:
    """Files by kind; those of folders have not been read.

    Attributes:
        named: Those that were named themselves, not by their folder.
        by_sort: Paths of each kind; a file may be of several.
        values: Content of those that were read.
        trajectories: Paths of polynomial trajectories.
        others: Paths of all other files.
        partly: Folders of which `MOST` files were looked at, the most that are.
    """

    named: set[Path] = field(default_factory=set)
    by_sort: dict[str, list[Path]] = field(default_factory=dict)
    values: dict[Path, Value] = field(default_factory=dict)
    trajectories: list[Path] = field(default_factory=list)
    others: list[Path] = field(default_factory=list)
    partly: list[Path] = field(default_factory=list)


def sorted_out(paths: Sequence[Path], registry: Registry) -> Files:
    """Sort files, and those in folders, by content.

    Raises:
        InputError: One that was named cannot be read, or none is of a known kind.
    """
    files = Files()
    problems: list[str] = []
    for path in paths:
        try:
            if path.is_dir():
                listed = [*files_in(path)]
                if len(listed) == MOST:
                    files.partly.append(path)
                for file in listed:
                    _add(files, file, registry, named=False)
            else:
                files.named.add(path)
                _add(files, path, registry, named=True)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    if not files.by_sort and not files.trajectories:
        raise InputError(
            f"{', '.join(map(str, paths))}: contains none of 'command_sequence', 'environment', "
            "'april_tags' (the original STAR), 'robots' (Crazyswarm2), 'crazyflies' (Crazyswarm) "
            "and 'geos' (Lighthouse), and no numbers of Loco anchors",
            "wrong-file",
        )
    return files


def recognizes(path: Path) -> bool:
    """Return whether a file is in this format, or a folder has a mission or robots of it."""
    if not path.is_dir():
        return bool(sorts_of(path) & FLOWN)
    if (path / "manifest.json").exists():  # a record
        return False
    return any(sorts_of(file) & {"mission", "robots"} for file in files_in(path))


def sorts_of(path: Path) -> set[str]:
    """Return what kinds of files one may be, by the words at the beginnings of its lines."""
    keys = _keys(path)
    return set() if keys.keys() & OWN else _sorts(keys)


def misspelled(path: Path) -> tuple[int, str, str] | None:
    """Return line and key of a file of no known kind, and the key that is probably meant."""
    keys = _keys(path)
    if keys.keys() & OWN:
        return None
    marks = [mark for sort in SORTS.values() for mark in sorted(sort)]
    for key, line in keys.items():
        if close := get_close_matches(key.lower(), marks, n=1, cutoff=SIMILAR):
            return line, key, close[0]
    return None


def _keys(path: Path) -> dict[str, int]:
    """Return the keys at the top of a YAML file that begin a line, with the numbers of the lines.

    They are as far indented as the first one.
    """
    if path.suffix not in {".yaml", ".yml"} or not path.is_file():
        return {}
    try:
        with path.open("rb") as stream:
            text = stream.read(LONGEST).removeprefix(BOM_UTF8)
    except OSError:
        return {}
    keys: dict[str, int] = {}
    indent: bytes | None = None
    for match in KEY.finditer(text):
        indent = match[1] if indent is None else indent
        if match[1] == indent:
            keys.setdefault(match[2].decode(), text.count(b"\n", 0, match.start()) + 1)
    return keys


def _sorts(keys: Collection[str]) -> set[str]:
    """Return what kinds of files have these keys at the top."""
    sorts = {sort for sort, marks in SORTS.items() if not marks.isdisjoint(keys)}
    if keys and all(key.isdigit() for key in keys):
        sorts = {"anchors"}
    # its list of commands is a default that no flight has
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


def is_trajectory(file: Path) -> bool:
    """Return whether a file begins as Crazyswarm2's trajectories do."""
    if file.suffix != ".csv":
        return False
    with file.open("rb") as stream:
        return stream.read(len(HEADER)).lower() == HEADER.encode()


def _add(files: Files, path: Path, registry: Registry, *, named: bool) -> None:
    if named and not path.is_file():
        raise InputError([f"{path}: no such file"])
    if path.suffix == ".csv" and (named or is_trajectory(path)):
        if path.name not in [other.name for other in files.trajectories]:
            files.trajectories.append(path)
        elif named:
            raise InputError([f"{path}: another file is named {path.name!r} too; rename one"])
        return
    sorts = sorts_of(path)
    if named:
        files.values[path] = value = format_function("values", registry)(path)
        sorts = _sorts(value.map())
    for sort in sorts:
        of_sort = files.by_sort.setdefault(sort, [])
        if path not in of_sort:
            of_sort.append(path)
    if not sorts:
        files.others.append(path)
