"""Selects, of the files that were read, those of each mission."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from os.path import normpath
from pathlib import Path
from typing import Any, Final

from star_core import InputError, Registry
from star_core.formats import Value, format_function
from star_import.sources import (
    SINGLE,
    Files,
    Sources,
    files_in,
    sorted_out,
    sorts_of,
)

ENVIRONMENT: Final = "environment_file"


@dataclass(frozen=True, slots=True)
class Choice:
    """How an environment is chosen among several.

    Attributes:
        name: Of the environment; empty for that of the original's configuration.
        option: How a user names it, without the name: ``--environment `` or an assignment.
    """

    name: str
    option: str


def selected(paths: Sequence[Path], choice: Choice, registry: Registry) -> Iterator[Sources]:
    """Yield the files of each mission of some files and folders; once if there is no mission.

    Raises:
        InputError: A file cannot be read, or it is not clear which of several is meant.
    """
    files = sorted_out(paths, registry)
    shown = ", ".join(map(str, paths))

    def read(path: Path) -> Value:
        if path not in files.values:
            files.values[path] = format_function("values", registry)(path)
        return files.values[path]

    chosen = {sort: _only(files, sort, shown) for sort in SINGLE}
    single: dict[str, Any] = {sort: read(path) for sort, path in chosen.items() if path}
    environment = _environment(files, single.get("config"), choice, shown)
    missions: list[Path | None] = [*_preferred(files, "mission")] or [None]
    sources = Sources(
        environment=read(environment) if environment else None,
        calibrations=[*map(read, files.by_sort.get("calibration", ()))],
        trajectories=files.trajectories,
        others=files.others,
        partly=files.partly,
        **single,
    )
    if missions != [None]:
        named = [path for path in files.trajectories if path in files.named]
        sources = replace(sources, trajectories=named)
    for mission in missions:
        try:
            yield replace(sources, mission=read(mission) if mission else None)
        except InputError as error:
            yield replace(sources, broken=error)


def with_surroundings(path: Path) -> list[Path]:
    """Return a mission and the folder around it, or any other path alone.

    It is the mission's folder, or the one above if that has robots.
    """
    if path.is_dir() or "mission" not in sorts_of(path):
        return [path]
    root = path.parent
    for folder in (path.parent, Path(normpath(path.parent / ".."))):
        if any("robots" in sorts_of(file) for file in files_in(folder)):
            root = folder
            break
    return [path, root]


def _preferred(files: Files, sort: str) -> list[Path]:
    """Return the files of a kind: those that were named, if any were."""
    of_sort = files.by_sort.get(sort, [])
    return [path for path in of_sort if path in files.named] or of_sort


def _only(files: Files, sort: str, shown: str) -> Path | None:
    """Return the only file of a kind, if there is one.

    Raises:
        InputError: There are several.
    """
    several = _preferred(files, sort)
    if len(several) > 1:
        names = ", ".join(map(str, several))
        text = f"{shown}: has several files of {sort}: {names}; name the one to use beside it"
        raise InputError(text, "wrong-file")
    return several[0] if several else None


def _environment(files: Files, config: Value | None, choice: Choice, shown: str) -> Path | None:
    """Return the environment of the missions, if there is one.

    Raises:
        InputError: There are several, or none with the name that is chosen.
    """
    every = files.by_sort.get("environment", [])
    several = _preferred(files, "environment")
    name, where = choice.name, f"{choice.option}{choice.name}"
    if not name and len(several) == 1 and several[0] in files.named:
        return several[0]
    if not name and config and (value := config.map().get(ENVIRONMENT)):
        name, where = value.text(), value.begins_at
    listed = ", ".join(path.name for path in every)
    hint = f"{choice.option}NAME chooses one of {listed}"
    if not name and len(several) > 1:
        raise InputError(f"{shown}: has several environments; {hint}", "wrong-file")
    chosen = [path for path in every if not name or name in {path.name, path.stem}]
    if name and every and not chosen:
        raise InputError(f"{where}: no environment {name!r}; {hint}", "file-not-found")
    return chosen[0] if chosen else None
