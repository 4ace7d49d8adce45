"""Reads a study from YAML, and checks every combination of its levels."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from itertools import combinations, count, islice, product
from math import prod
from pathlib import Path
from typing import Any, Final, TypeAlias

from star_ablate.study import COLUMNS, Condition, Study
from star_core import InputError, Mission, Registry, load, read_as

MEASURES: Final = (
    "collisions.agent_agent",
    "collisions.agent_obstacle",
    "min_separation_m",
    "position_mse_m2.mean",
    "path_length_m.total",
    "flight_time_s",
)
SEEDS: Final = 10
MOST: Final = 10_000
"""Combinations of missions and levels, each of which is checked before the first flight."""

OWN: Final = "own"
"""Value of `seeds` for flying each mission with its own seed."""

Locate: TypeAlias = Callable[[tuple[str | int, ...], str], str]
"""Adds the location of a path in the study file to a message."""


def read(path: Path, registry: Registry, seeds: int | None = None) -> Study:
    """Read the study at `path` and check every mission that it would fly.

    Args:
        path: The study file.
        registry: Registry of the plugins.
        seeds: Number of seeds, overriding the study's: its first seeds and, if it has fewer, those
            following its greatest.

    Raises:
        InputError: It cannot be read, a mission cannot be flown at some level, or a number of seeds
            is given while each mission has its own; lists every reason.
    """
    document = read_as(path, "study")
    data = document.data
    factors: Mapping[str, Any] = data.get("factors", {})
    files, problems = _files(path, data["missions"], document.problem)
    problems += _clashes(factors, document.problem)
    many = len(files) * prod(len(levels) for levels in factors.values())
    if many > MOST:
        why = f"they have {many} combinations with the missions, expected {MOST} at most"
        problems.append(document.problem(("factors",), why))
    if seeds is not None and data.get("seeds") == OWN:
        why = f"each mission flies with its {OWN!r} seed, so --seeds {seeds} has no effect"
        problems.append(document.problem(("seeds",), why))
    if problems:
        raise InputError(problems)
    conditions, problems = _conditions(files, factors, registry, document.problem)
    if problems:
        raise InputError(list(dict.fromkeys(problems)))  # a level may be wrong in every mission
    return Study(
        name=data["name"],
        factors=tuple(factors),
        conditions=tuple(conditions),
        seeds=_seeds(data.get("seeds", SEEDS), seeds),
        measures=tuple(data.get("measures", MEASURES)),
        time_limit=data.get("time_limit"),
        data=data,
    )


def _files(study: Path, names: list[str], locate: Locate) -> tuple[list[Path], list[str]]:
    """Return the mission files, and their problems.

    They must be inside the folder above the study's own, so that ``missions/studies/`` can name
    files in ``missions/``, and no study can name files elsewhere.
    """
    files: list[Path] = []
    problems = []
    top = study.resolve().parent.parent
    for i, name in enumerate(names):
        file = study.parent / name
        try:
            within = file.resolve().is_relative_to(top)
        except (OSError, RuntimeError):  # circular links
            within = False
        if Path(name).is_absolute() or not within:
            wrong = f"{name!r} is outside the folder above the study's; name a file inside it"
        elif not file.is_file():
            wrong = f"there is no file {name!r} from the study's folder{_meant(study, name)}"
        elif (twin := next((f for f in files if f.stem == file.stem), None)) is not None:
            wrong = f"{name!r} is indistinguishable from {str(twin)!r} in the results; rename one"
        else:
            files.append(file)
            continue
        problems.append(locate(("missions", i), wrong))
    return files, problems


def _meant(study: Path, name: str) -> str:
    """Suggest a similar file name in the same folder."""
    beside = [
        str(Path(name).parent / file.name) for file in (study.parent / name).parent.glob("*.yaml")
    ]
    return "".join(f"; did you mean {near!r}?" for near in get_close_matches(name, beside, 1))


def _clashes(factors: Mapping[str, Any], locate: Locate) -> list[str]:
    """Return the problems of factors, individually and in combination."""
    problems = [
        locate(
            ("factors", name), f"a factor cannot be called {name!r}: the results have that column"
        )
        for name in factors
        if name in COLUMNS
    ]
    for name, levels in factors.items():
        problems += [
            locate(("factors", name, level, "seed"), "the seed cannot be a level; set `seeds`")
            for level, settings in levels.items()
            if "seed" in settings
        ]
    for first, second in combinations(factors, 2):
        taken = {path for settings in factors[first].values() for path in settings}
        for level, settings in factors[second].items():
            problems += [
                locate(
                    ("factors", second, level, path),
                    f"{path!r} would undo what factor {first!r} sets; write {second!r} first or"
                    " make one factor of both",
                )
                for path in settings
                if any(f"{other}.".startswith(f"{path}.") for other in taken)
            ]
    return problems


def _conditions(
    files: list[Path], factors: Mapping[str, Any], registry: Registry, locate: Locate
) -> tuple[list[Condition], list[str]]:
    """Load every mission at every combination of levels; return them and their problems.

    A problem of a mission at all its levels is reported once, and a problem at some of them with
    the first of those.
    """
    conditions = []
    problems = []
    combos = [dict(zip(factors, names, strict=True)) for names in product(*factors.values())]
    for file in files:
        found: dict[str, list[str]] = {}
        for levels in combos:
            try:
                mission = _load(file, levels, factors, registry, locate)
                conditions.append(Condition(file.stem, levels, mission))
            except InputError as error:
                label = ", ".join(f"{name}: {level}" for name, level in levels.items())
                for problem in dict.fromkeys(error.problems):
                    found.setdefault(problem, []).append(label)
        for problem, labels in found.items():
            text, _, code = problem.rpartition(" [")
            only = len(labels) < len(combos)
            problems.append(f"{text}; with {labels[0]} [{code}" if only else problem)
    return conditions, problems


def _load(
    file: Path,
    levels: Mapping[str, str],
    factors: Mapping[str, Any],
    registry: Registry,
    locate: Locate,
) -> Mission:
    """Load a mission with the overrides of its levels.

    Raises:
        InputError: It cannot be flown. Problems of overrides are located in the study.
    """
    places = {
        f"{path}={json.dumps(value)}": ("factors", name, level, path)
        for name, level in levels.items()
        for path, value in factors[name][level].items()
    }
    try:
        return load(file, registry, list(places))
    except InputError as error:
        problems = []
        for problem in error.problems:
            for assignment, place in places.items():
                start = f"--set {assignment}: "
                if problem.startswith(start):
                    problems.append(locate(place, problem.removeprefix(start)))
                    break
            else:
                problems.append(problem)
        raise InputError(problems) from None


def _seeds(
    given: int | list[int] | Mapping[str, int] | str, wanted: int | None
) -> tuple[int, ...] | None:
    if isinstance(given, str):
        return None
    if isinstance(given, list):
        own = given
    else:
        first, number = (
            (0, given) if isinstance(given, int) else (given.get("first", 0), given["count"])
        )
        own = list(range(first, first + number))
    if wanted is None:
        return tuple(own)
    return (*own[:wanted], *islice(count(max(own) + 1), max(0, wanted - len(own))))
