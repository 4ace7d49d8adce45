"""The input files of an import, sorted by content."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from star_core import InputError, Registry
from star_core.formats import Value, format_function


@dataclass(slots=True)
class Sources:
    """Input files by kind, if present.

    Attributes:
        mission: The original STAR's list of commands, and its path.
        environment: Its obstacles and tags, and their path.
        robots: Crazyswarm2's robots, and their path.
        trajectories: Paths of polynomial trajectories.
    """

    mission: tuple[Path, Value] | None = None
    environment: tuple[Path, Value] | None = None
    robots: tuple[Path, Value] | None = None
    trajectories: list[Path] = field(default_factory=list)


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
    sorts = {
        "mission": "command_sequence" in keys,
        "environment": bool(keys & {"environment", "april_tags"}),
        "robots": "robots" in keys,
    }
    for sort, is_it in sorts.items():
        if is_it:
            if before := getattr(sources, sort):
                raise InputError([f"{path}: same kind of file as {before[0]}; give one of them"])
            setattr(sources, sort, (path, value))
    if not any(sorts.values()):
        raise value.wrong(
            "contains none of 'command_sequence', 'environment', 'april_tags' (the original STAR) "
            "and 'robots' (Crazyswarm2)"
        )
