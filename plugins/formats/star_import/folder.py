"""The format ``original-star``: flies files of the original STAR and of Crazyswarm2 as they are.

A folder has missions, environments, robots and the original's configuration; a mission by itself is
flown with the files around it. They are imported into a temporary folder and loaded from there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from os.path import normpath
from pathlib import Path
from typing import Any, Final, TypeAlias

from star_core import InputError, Mission, Problem, Registry
from star_core import load as load_mission
from star_core.formats import SourceFile, check_file
from star_core.toolkit import Action, Node
from star_import.assembly import ImportOptions, assemble
from star_import.import_log import ImportLog
from star_import.output_files import OutputFiles
from star_import.sources import Sources, files_in, sorted_out, sorts_of

Relocate: TypeAlias = Callable[[str], str]

ENVIRONMENT: Final = "environment_file"
START: Final = re.compile(r"swarm\.([^.=]+)\.start=\s*\[([^]]*)\]\s*")
NEW_AGENT: Final = "--set swarm.{}.start=[X, Y, 0]"
HEADER: Final = "duration"  # begins Crazyswarm2's trajectories


def load(path: Path, registry: Registry, assignments: Sequence[str]) -> Mission:
    """Return the mission of a file or a folder.

    Raises:
        InputError: It cannot be flown, or the folder has several missions.
    """
    changes = _Changes.of(assignments)
    imports = [*_imports(path, changes.environment, registry)]
    if len(imports) > 1:
        missions = ", ".join(str(files[0]) for _, files in imports)
        raise InputError(f"{path}: has several missions; name one: {missions}", "wrong-file")
    source = _imported(*imports[0], changes, registry)
    if source.files.mission is None:
        raise InputError(f"{path}: is an environment, expected a mission or robots", "wrong-file")
    with source.files.staged(path) as staged:
        mission = load_mission(staged, registry, changes.of_mission)
    where = partial(source.files.relocated, staged=staged.parent, folder=path)
    origin = partial(source.files.origin, staged=staged.parent)
    return replace(
        mission.with_steps(partial(_with_origin, origin=origin)),
        scene=replace(mission.scene, folder=source.root, files={}),
        file=ImportedFile(source.path, mission.file, where),
        world_file=ImportedFile(source.world, mission.world_file, where),
        warnings=(*source.warnings, *map(where, mission.warnings)),
    )


def check(path: Path, registry: Registry, assignments: Sequence[str]) -> tuple[str, Sequence[str]]:
    """Return what each mission of a file or a folder is good for, and warnings.

    Raises:
        InputError: One cannot be flown.
    """
    texts, warnings, problems = list[str](), list[str](), list[str]()
    changes = _Changes.of(assignments)
    for root, paths in _imports(path, changes.environment, registry):
        try:
            source = _imported(root, paths, changes, registry)
            with source.files.staged(path) as staged:
                if source.files.mission is None:
                    load_mission(staged, registry)
                    texts.append(f"{path}: an environment that missions can be flown in")
                    continue
                text, of_mission = check_file(staged, registry, changes.of_mission)
        except InputError as error:
            problems += error.problems
            continue
        where = partial(source.files.relocated, staged=staged.parent, folder=path)
        texts.append(text.replace(str(staged), str(source.path)))
        warnings += [*source.warnings, *map(where, of_mission)]
    if problems:
        raise InputError(list(dict.fromkeys(problems)))
    return "\n".join(texts), list(dict.fromkeys(warnings))


@dataclass(frozen=True, slots=True)
class ImportedFile:
    """A file of a temporary folder, whose problems have the locations it was imported from.

    Attributes:
        path: The file that it was imported from.
        staged: The file as loaded.
        where: Returns a problem with the location it was imported from.
    """

    path: Path
    staged: SourceFile
    where: Relocate

    @property
    def data(self) -> dict[str, Any]:
        """The content of the imported file."""
        return self.staged.data

    def problem(
        self,
        path: tuple[str | int, ...],
        message: str,
        code: str = "invalid-option",
        *,
        key: bool = False,
    ) -> str:
        """Return a problem with the location it was imported from."""
        return self.where(self.staged.problem(path, message, code, key=key))

    def located(self, problems: Iterable[Problem]) -> list[str]:
        """Return problems with the locations they were imported from."""
        return [*map(self.where, self.staged.located(problems))]


@dataclass(frozen=True, slots=True)
class _Import:
    """An import of one mission.

    Attributes:
        path: The mission, or else the robots or the environment.
        world: The environment, or else `path`.
        root: Folder in which the mission's files are.
        files: What the import writes.
        warnings: Of the import.
    """

    path: Path
    world: Path
    root: Path
    files: OutputFiles
    warnings: Sequence[str]


@dataclass(frozen=True, slots=True)
class _Changes:
    """Values of ``--set``.

    Attributes:
        environment: Name of the environment; empty for that of the original's configuration.
        agents: ``NAME=X,Y`` each, which the files may lack.
        of_mission: Those to be set in the imported mission.
    """

    environment: str
    agents: Sequence[str]
    of_mission: Sequence[str]

    @classmethod
    def of(cls, assignments: Sequence[str]) -> _Changes:
        environment, agents, others = "", list[str](), list[str]()
        for assignment in assignments:
            if assignment.startswith(f"{ENVIRONMENT}="):
                environment = assignment.partition("=")[2].strip()
            elif match := START.fullmatch(assignment):
                agents.append(f"{match[1]}={match[2].replace(' ', '')}")
            else:
                others.append(assignment)
        return cls(environment, agents, others)


def _imported(root: Path, paths: Sequence[Path], changes: _Changes, registry: Registry) -> _Import:
    """Return the import of some files in a folder.

    Raises:
        InputError: They cannot be imported; lists every reason.
    """
    sources = sorted_out(paths, registry)
    log = ImportLog(NEW_AGENT)
    files = assemble(sources, ImportOptions(agents=changes.agents, direct=True), log)
    if sources.config and not sources.environment:
        log.warning(str(sources.config[0]), f"its environment is not in {root}; it flies in none")
    main = sources.paths[0]
    command = f"star import {' '.join(map(str, sources.paths))}"
    count = f"{main}: {len(log.assumptions)} values were assumed; `{command}` lists them"
    return _Import(
        path=main,
        world=sources.environment[0] if sources.environment else main,
        root=root,
        files=files.located(str(main)),
        warnings=[*dict.fromkeys(log.warnings), count],
    )


def _imports(
    path: Path, environment: str, registry: Registry
) -> Iterator[tuple[Path, Sequence[Path]]]:
    """Yield the files of each mission, itself first, and the folder that has them.

    Args:
        path: A file or a folder.
        environment: Name of the environment; empty for that of the original's configuration.
        registry: Registry of the formats.
    """
    if path.is_file() and "mission" not in sorts_of(path):
        yield path.parent, [path]
        return
    root = path if path.is_dir() else _root(path)
    files = {file: sorts_of(file) for file in files_in(root)}
    missions = [file for file in files if "mission" in files[file]] if path.is_dir() else [path]
    around = [*_only("robots", files, root), *_only("config", files, root)]
    around += _only("tags", files, root)
    environments = [file for file in files if "environment" in files[file]]
    around += _environment(root, environments, environment, sorted_out(around, registry))
    if missions:
        for mission in missions:
            yield root, list(dict.fromkeys([mission, *around]))
        return
    yield root, [*around, *(file for file in files if file.parent == root and _is_trajectory(file))]


def _root(mission: Path) -> Path:
    """Return the folder of a mission or the one above, whichever has robots, or else its own."""
    for folder in (mission.parent, Path(normpath(mission.parent / ".."))):
        if any("robots" in sorts_of(file) for file in files_in(folder)):
            return folder
    return mission.parent


def _only(sort: str, files: Mapping[Path, Collection[str]], root: Path) -> list[Path]:
    """Return the only file of a kind, if there is one.

    Raises:
        InputError: There are several.
    """
    several = [file for file in files if sort in files[file]]
    if len(several) > 1:
        names = ", ".join(map(str, several))
        text = f"{root}: has several files of {sort}: {names}; keep one, or use `star import`"
        raise InputError(text, "wrong-file")
    return several


def _environment(
    root: Path, environments: Sequence[Path], named: str, around: Sources
) -> Sequence[Path]:
    """Return the environment of a folder's missions, if there is one.

    Raises:
        InputError: There are several, or none with the name that is set.
    """
    where = f"--set {ENVIRONMENT}={named}"
    if not named and around.config and (value := around.config[1].map().get(ENVIRONMENT)):
        named, where = value.text(), value.begins_at
    listed = ", ".join(file.name for file in environments)
    hint = f"--set {ENVIRONMENT}=NAME chooses one of {listed}"
    if not named and len(environments) > 1:
        raise InputError(f"{root}: has several environments; {hint}", "wrong-file")
    chosen = [file for file in environments if not named or named in {file.name, file.stem}]
    if named and environments and not chosen:
        raise InputError(f"{where}: no environment {named!r}; {hint}", "file-not-found")
    return chosen[:1]


def _is_trajectory(file: Path) -> bool:
    if file.suffix != ".csv":
        return False
    with file.open("rb") as stream:
        return stream.read(len(HEADER)) == HEADER.encode()


def _with_origin(step: Node, origin: Relocate) -> Node:
    """Return a step that, if it is an action, has the location that it was imported from."""
    return replace(step, location=origin(step.location)) if isinstance(step, Action) else step
