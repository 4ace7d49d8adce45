"""Reads a study from YAML, and checks every combination of its levels."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, count, islice
from pathlib import Path
from typing import Any, Final, TypeAlias

from star_ablate import design, measures
from star_ablate.basis import Basis
from star_ablate.study import Condition, Study
from star_core import InputError, Mission, Problem, Registry, load
from star_core.formats import SourceFile, read_as
from star_core.toolkit import STUDY_COLUMNS, Progress, suggestion

MEASURES: Final = (
    "collisions.agent_agent",
    "collisions.agent_obstacle",
    "min_separation_m",
    "position_mse_m2.mean",
    "path_length_m.total",
    "flight_time_s",
)
SEEDS: Final = 10
OWN: Final = "own"  # seeds: each mission flies with its own

Factors: TypeAlias = Mapping[str, Mapping[str, Mapping[str, Any]]]  # overrides by factor and level


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
    return study_of(read_as(path, "study", registry), registry, seeds)


def schema(_registry: Registry) -> dict[str, Any]:
    """Return the schema of studies."""
    file = Path(__file__).with_name("study.schema.json")
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return content


def check(document: SourceFile, registry: Registry) -> str:
    """Return what a study flies, in words.

    Raises:
        InputError: As `study_of`.
    """
    study = study_of(document, registry)
    runs = len(list(study.runs()))
    return f"{study.name!r}, a study of {runs} run{'s' * (runs > 1)}"


def study_of(document: SourceFile, registry: Registry, seeds: int | None = None) -> Study:
    """Return the study of a file that fits the schema; arguments and errors are those of `read`."""
    path, data = document.path, document.data
    factors: Factors = data.get("factors", {})
    files = [path.parent / name for name in data["missions"]]
    problems = [
        *_file_problems(path, files, data["missions"]),
        *_factor_problems(factors),
        *design.problems(data, [file.stem for file in files]),
    ]
    if seeds is not None and data.get("seeds") == OWN:
        why = f"each mission flies with its {OWN!r} seed, so --seeds {seeds} has no effect"
        problems.append(Problem(("seeds",), why, "option-conflict"))
    listed = data.get("measures", ())
    undeclared = measures.undeclared(listed, registry)
    if not measures.may_measure_more(registry):
        problems += measures.problems(listed, measures.offered(registry), undeclared)
    if problems:
        raise InputError(document.located(problems))
    return Study(
        name=data["name"],
        factors=tuple(factors),
        conditions=tuple(_conditions(files, registry, document)),
        seeds=_seeds(data.get("seeds", SEEDS), seeds),
        measures=tuple(data.get("measures", MEASURES)),
        time_limit=data.get("time_limit"),
        data=data,
        file=document,
        undeclared=tuple(undeclared),
    )


def _file_problems(study: Path, files: Sequence[Path], names: Sequence[str]) -> Iterator[Problem]:
    """Yield the problems of mission files: only files inside the folder above the study's own."""
    top = study.resolve().parent.parent
    stems: dict[str, Path] = {}
    for i, (file, name) in enumerate(zip(files, names, strict=True)):
        try:
            within = not Path(name).is_absolute() and file.resolve().is_relative_to(top)
        except (OSError, RuntimeError):  # circular links
            within = False
        twin = stems.setdefault(file.stem, file)
        if not within:
            wrong = f"{name!r} is outside the folder above the study's; name a file inside it"
            yield Problem(("missions", i), wrong, "file-not-found")
        elif not file.is_file():
            beside = [str(Path(name).parent / other.name) for other in file.parent.glob("*.yaml")]
            wrong = f"there is no file {name!r} from the study's folder{suggestion(name, beside)}"
            yield Problem(("missions", i), wrong, "file-not-found")
        elif twin is not file:
            wrong = f"{name!r} is indistinguishable from {str(twin)!r} in the results; rename one"
            yield Problem(("missions", i), wrong, "duplicate-name")


def _factor_problems(factors: Factors) -> Iterator[Problem]:
    """Yield the problems of factors, individually and in combination."""
    for name, levels in factors.items():
        if name in (*STUDY_COLUMNS, "wall_time_s"):
            wrong = f"a factor cannot be called {name!r}: the results have that column"
            yield Problem(("factors", name), wrong, "duplicate-name")
        for level, settings in levels.items():
            if "seed" in settings:
                wrong = "the seed cannot be a level; set `seeds`"
                yield Problem(("factors", name, level, "seed"), wrong, "option-conflict")
    for first, second in combinations(factors, 2):
        taken = {path for settings in factors[first].values() for path in settings}
        for level, settings in factors[second].items():
            for path in settings:
                if any(f"{other}.".startswith(f"{path}.") for other in taken):
                    wrong = (
                        f"{path!r} would undo what factor {first!r} sets; write {second!r} first or"
                        " make one factor of both"
                    )
                    yield Problem(("factors", second, level, path), wrong, "option-conflict")


def _conditions(files: Sequence[Path], registry: Registry, document: SourceFile) -> list[Condition]:
    """Load every mission at every combination of levels.

    A problem at all levels of a mission is reported once, one at some with the first of those.
    """
    conditions = []
    problems: list[str] = []
    basis = Basis(registry)
    combos_by_file = {file: design.combinations(document.data, file.stem) for file in files}
    total = sum(map(len, combos_by_file.values()))
    with Progress("checking", total, unit="missions") as progress:
        for file, combos in combos_by_file.items():
            labels_by_problem: dict[str, list[str]] = {}
            for levels in combos:
                try:
                    settings = _settings(levels, document.data.get("factors", {}))
                    mission = _load(file, settings, registry, document)
                    of = basis.of(mission)
                    conditions.append(Condition(file.stem, levels, mission, of, tuple(settings)))
                except InputError as error:
                    label = ", ".join(f"{name}: {level}" for name, level in levels.items())
                    for problem in dict.fromkeys(error.problems):
                        labels_by_problem.setdefault(problem, []).append(label)
                progress.done += 1
            problems += [
                problem if len(labels) == len(combos) else _with_level(problem, labels[0])
                for problem, labels in labels_by_problem.items()
            ]
    if problems:
        raise InputError(list(dict.fromkeys(problems)))  # a level may be wrong in every mission
    return conditions


def _with_level(problem: str, level: str) -> str:
    """Name the level at which a problem occurs, before its code."""
    text, _, code = problem.rpartition(" [")
    return f"{text}; with {level} [{code}"


def _settings(levels: Mapping[str, str], factors: Factors) -> dict[str, tuple[str, ...]]:
    """Return the paths in the study of what levels set, by the assignments of a mission."""
    return {
        f"{path}={json.dumps(value)}": ("factors", name, level, path)
        for name, level in levels.items()
        for path, value in factors[name][level].items()
    }


def _load(
    file: Path, settings: Mapping[str, tuple[str, ...]], registry: Registry, document: SourceFile
) -> Mission:
    """Load a mission with the assignments of its levels, whose problems are those of the study."""
    try:
        return load(file, registry, list(settings))
    except InputError as error:
        problems = list(error.problems)
        for assignment, path in settings.items():
            start = f"--set {assignment}: "
            problems = [
                document.problem(path, problem.removeprefix(start))
                if problem.startswith(start)
                else problem
                for problem in problems
            ]
        raise InputError(problems) from None


def _seeds(
    spec: int | list[int] | Mapping[str, int] | str, number: int | None
) -> tuple[int, ...] | None:
    if isinstance(spec, str):
        return None
    if isinstance(spec, int):
        spec = {"count": spec}
    if isinstance(spec, Mapping):
        first = spec.get("first", 0)
        spec = list(range(first, first + spec["count"]))
    if number is None:
        return tuple(spec)
    return (*spec[:number], *islice(count(max(spec) + 1), max(0, number - len(spec))))
