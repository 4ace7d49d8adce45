"""Fault files: what fails in a flight, when and for which agents."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from star_core.errors import MAX_LISTED, InputError, suggestion
from star_core.mission_file import schema
from star_core.mission_file.located import Document
from star_core.mission_file.step_tree import rows_of
from star_core.plugin_support.option_schema import fill_defaults
from star_core.plugin_support.specs import Problem
from star_core.scene import Scene, inside

if TYPE_CHECKING:
    from star_core.registry import Registry


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of one component of some agents.

    Attributes:
        component: Key ``component`` of a fault file.
        mode: One of PX4's words: off, stuck, garbage, wrong, slow, delayed or intermittent.
        at: Mission time at which it begins, s.
        until: By row of the agents that have it: when it ends, s; infinite at the end of the
            flight.
        values: The other keys, with their defaults.
        number: Index in the file, for random numbers.
    """

    component: str
    mode: str
    at: float
    until: Mapping[int, float]
    values: Mapping[str, Any]
    number: int = 0

    def rows(self, time: float) -> tuple[int, ...]:
        """Return the rows of the agents that have it at a mission time, s."""
        begun = time >= self.at
        return tuple(row for row, end in self.until.items() if begun and time < end)


def read_faults(path: Path, scene: Scene) -> tuple[Fault, ...]:
    """Return the faults of a flight from a fault file, with the seed's draws of probabilities.

    Raises:
        InputError: The file cannot be read, or has agents or landmarks that the scene has not.
    """
    document = schema.read_as(path, "faults")
    if found := document.located(_problems(document, scene)):
        raise InputError(found)
    return faults_of(document.data["faults"], scene)


def faults_of(given: list[Mapping[str, Any]], scene: Scene) -> tuple[Fault, ...]:
    """Return the faults of a flight from the list of a fault file; it has no mistakes."""
    import numpy as np

    rules = schema.load("faults")["$defs"]["fault"]
    groups = _groups(scene)
    made: list[Fault] = []
    for number, keys in enumerate(given):
        values = fill_defaults(keys, rules)
        at, rows = values.pop("at"), rows_of(values.pop("agents", "all"), groups)
        end = at + values.pop("for", math.inf)
        random = np.random.default_rng([scene.seed, number]).random(len(scene.agents))
        happens = random < values.pop("probability")
        component, mode = values.pop("component"), values.pop("mode")
        until = {row: end for row in rows if happens[row]}
        made.append(Fault(component, mode, at, until, values, number))
    repairs = [fault for fault in made if fault.mode == "ok"]
    return tuple(_repaired(fault, repairs) for fault in made if fault.mode != "ok")


def check_faults(document: Document, registry: Registry) -> str:
    """Return what a fault file holds, in words.

    Raises:
        InputError: It breaks its schema, or does not fit the mission that it names.
    """
    from star_core.mission_file.mission_loader import load

    if found := schema.problems(document, schema.load("faults")):
        raise InputError(found)
    count = len(document.data["faults"])
    words = f"{count} fault{'s' * (count > 1)} to inject"
    if "mission" not in document.data:
        return words
    folder = document.path.resolve().parent
    try:
        path = inside(folder.parent, f"{folder.name}/{document.data['mission']}")
        mission = load(path, registry)
    except InputError as error:
        raise InputError([document.problem(("mission",), one) for one in error.problems]) from None
    if found := document.located(_problems(document, mission.scene)):
        raise InputError(found)
    return f"{words} into {mission.name!r}"


def _repaired(fault: Fault, repairs: list[Fault]) -> Fault:
    """Return a fault that ends where a later one in mode ``ok`` of its component begins."""
    until = dict(fault.until)
    for repair in repairs:
        if repair.component == fault.component and repair.at > fault.at:
            until |= {row: min(until[row], repair.at) for row in repair.until if row in until}
    return replace(fault, until=until)


def _groups(scene: Scene) -> dict[str, tuple[int, ...]]:
    rows = {name: (row,) for row, name in enumerate(scene.names)}
    return {**scene.groups, **rows, "all": tuple(range(len(rows)))}


def _problems(document: Document, scene: Scene) -> Iterator[Problem]:
    """Yield the agents and landmarks that a scene has not."""
    known = {
        "agents": ("agent", [*_groups(scene)], "unknown-agent"),
        "tags": ("landmark", sorted({tag.of for tag in scene.world.landmarks}), "unknown-landmark"),
    }
    for number, fault in enumerate(document.data["faults"]):
        for key, (noun, names, code) in known.items():
            given = fault.get(key, ())
            for i, name in enumerate([given] if isinstance(given, str) else given):
                if name not in names:
                    path = ("faults", number, key, *(() if isinstance(given, str) else (i,)))
                    hint = suggestion(name, names, "there are", MAX_LISTED)
                    yield Problem(path, f"no {noun} named {name!r}{hint}", code)
