"""Fault files: what fails in a flight, when and for which agents."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from star_core import InputError, Problem, Registry, Scene, load
from star_core.formats import SourceFile, inside, read_as
from star_core.toolkit import Fault, fill_defaults, suggestion

SCHEMA: Final = Path(__file__).with_name("faults.schema.json")
MAX_LISTED: Final = 10  # names in a message


def schema(_registry: Registry) -> dict[str, Any]:
    """Return the schema of fault files."""
    content: dict[str, Any] = json.loads(SCHEMA.read_text(encoding="utf-8"))
    return content


def read_faults(path: Path, scene: Scene, registry: Registry) -> tuple[Fault, ...]:
    """Return the faults of a flight from a fault file, with the seed's draws of probabilities.

    Raises:
        InputError: The file cannot be read, or has agents or landmarks that the scene has not.
    """
    document = read_as(path, "faults", registry)
    if problems := document.located(_problems(document, scene)):
        raise InputError(problems)
    return faults_of(document.data["faults"], scene)


def faults_of(entries: list[Mapping[str, Any]], scene: Scene) -> tuple[Fault, ...]:
    """Return the faults of a flight from the list of a fault file; it has no mistakes."""
    import numpy as np

    rules = json.loads(SCHEMA.read_text(encoding="utf-8"))["$defs"]["fault"]
    groups = scene.rows_by_name
    made: list[Fault] = []
    for number, keys in enumerate(entries):
        values = fill_defaults(keys, rules)
        at, names = values.pop("at"), values.pop("agents", "all")
        names = [names] if isinstance(names, str) else names
        rows = sorted({row for name in names for row in groups[name]})
        end = at + values.pop("for", math.inf)
        random = np.random.default_rng([scene.seed, number]).random(len(scene.agents))
        happens = random < values.pop("probability")
        component, mode = values.pop("component"), values.pop("mode")
        until = {row: end for row in rows if happens[row]}
        made.append(Fault(component, mode, at, until, values, number))
    repairs = [fault for fault in made if fault.mode == "ok"]
    return tuple(_repaired(fault, repairs) for fault in made if fault.mode != "ok")


def check(document: SourceFile, registry: Registry) -> str:
    """Return what a fault file holds, in words.

    Raises:
        InputError: It does not fit the mission that it names.
    """
    count = len(document.data["faults"])
    words = f"{count} fault{'s' * (count > 1)} to inject"
    if "mission" not in document.data:
        return words
    folder = document.path.resolve().parent
    try:
        path = inside(folder.parent, f"{folder.name}/{document.data['mission']}")
        mission = load(path, registry)
    except InputError as error:
        raise InputError(
            [document.problem(("mission",), message) for message in error.problems]
        ) from None
    if problems := document.located(_problems(document, mission.scene)):
        raise InputError(problems)
    return f"{words} into {mission.name!r}"


def _repaired(fault: Fault, repairs: list[Fault]) -> Fault:
    """Return a fault that ends where a later one in mode ``ok`` of its component begins."""
    until = dict(fault.until)
    for repair in repairs:
        if repair.component == fault.component and repair.at > fault.at:
            until |= {row: min(until[row], repair.at) for row in repair.until if row in until}
    return replace(fault, until=until)


def _problems(document: SourceFile, scene: Scene) -> Iterator[Problem]:
    """Yield the agents and landmarks that a scene has not."""
    references = {
        "agents": ("agent", [*scene.rows_by_name], "unknown-agent"),
        "tags": ("landmark", sorted({tag.of for tag in scene.world.landmarks}), "unknown-landmark"),
    }
    for number, fault in enumerate(document.data["faults"]):
        for key, (noun, names, code) in references.items():
            value = fault.get(key, ())
            for i, name in enumerate([value] if isinstance(value, str) else value):
                if name not in names:
                    path = ("faults", number, key, *(() if isinstance(value, str) else (i,)))
                    hint = suggestion(name, names, "there are", MAX_LISTED)
                    yield Problem(path, f"no {noun} named {name!r}{hint}", code)
