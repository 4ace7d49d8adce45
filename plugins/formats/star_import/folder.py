"""The format ``original-star``: flies files of the original STAR and of Crazyswarm2 as they are.

A folder has missions, environments, robots and the original's configuration; a mission by itself is
flown with the files around it. They are imported into a temporary folder and loaded from there.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeAlias

from star_core import InputError, Mission, Problem, Registry
from star_core import load as load_mission
from star_core.formats import SourceFile, check_file
from star_core.toolkit import Action, Node
from star_import.assembly import ImportOptions, assemble
from star_import.import_log import ImportLog
from star_import.output_files import OutputFiles
from star_import.selection import ENVIRONMENT, Choice, selected, with_surroundings
from star_import.sources import Sources, path_of

Relocate: TypeAlias = Callable[[str], str]

START: Final = re.compile(r"swarm\.([^.=]+)\.start=\s*\[([^]]*)\]\s*")
TARGET: Final = re.compile(r"target\.(\d+)=\s*\[([^],]*),([^],]*)\]\s*")
NEW_AGENT: Final = "--set swarm.{}.start=[X, Y, 0]"
NEW_TARGET: Final = "--set target.{}=[X, Y]"


def load(path: Path, registry: Registry, assignments: Sequence[str]) -> Mission:
    """Return the mission of a file or a folder.

    Raises:
        InputError: It cannot be flown, or the folder has several missions.
    """
    changes = _Changes.of(assignments)
    several = [*selected(with_surroundings(path), changes.environment, registry)]
    if len(several) > 1:
        missions = ", ".join(str(sources.paths[0]) for sources in several)
        raise InputError(f"{path}: has several missions; name one: {missions}", "wrong-file")
    source = _imported(path, several[0], changes, registry)
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
    for sources in selected(with_surroundings(path), changes.environment, registry):
        try:
            source = _imported(path, sources, changes, registry)
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
        environment: Which environment to take.
        agents: ``NAME=X,Y`` each, which the files may lack.
        targets: Positions of targets that have none, by their number, m.
        of_mission: Those to be set in the imported mission.
    """

    environment: Choice
    agents: Sequence[str]
    targets: dict[int, tuple[float, float]]
    of_mission: Sequence[str]

    @classmethod
    def of(cls, assignments: Sequence[str]) -> _Changes:
        environment, agents, others = "", list[str](), list[str]()
        targets: dict[int, tuple[float, float]] = {}
        for assignment in assignments:
            if assignment.startswith(f"{ENVIRONMENT}="):
                environment = assignment.partition("=")[2].strip()
            elif match := START.fullmatch(assignment):
                agents.append(f"{match[1]}={match[2].replace(' ', '')}")
            elif match := TARGET.fullmatch(assignment):
                try:
                    targets[int(match[1])] = (float(match[2]), float(match[3]))
                except ValueError:
                    expected = NEW_TARGET.format(match[1])
                    text = f"--set {assignment}: expected {expected} in m"
                    raise InputError(text, "wrong-type") from None
            else:
                others.append(assignment)
        return cls(Choice(environment, f"--set {ENVIRONMENT}="), agents, targets, others)


def _imported(path: Path, sources: Sources, changes: _Changes, registry: Registry) -> _Import:
    """Return the import of some files in a folder.

    Raises:
        InputError: They cannot be imported; lists every reason.
    """
    log = ImportLog(NEW_AGENT)
    options = ImportOptions(
        agents=changes.agents,
        target_positions=changes.targets,
        new_target=NEW_TARGET,
        direct=True,
    )
    files = assemble(sources, options, log, registry)
    main = sources.paths[0]
    command = f"star import {' '.join(map(str, with_surroundings(path)))}"
    count = f"{main}: warning: `{command}` lists what was assumed and ignored"
    return _Import(
        path=main,
        world=path_of(sources.environment) if sources.environment else main,
        root=path
        if path.is_dir()
        else with_surroundings(path)[-1]
        if sources.mission
        else main.parent,
        files=replace(files, origin_of_all=str(main)),
        warnings=[*log.warnings(), count],
    )


def _with_origin(step: Node, origin: Relocate) -> Node:
    """Return a step that, if it is an action, has the location that it was imported from."""
    return replace(step, location=origin(step.location)) if isinstance(step, Action) else step
