"""Which combinations a study flies, and what the results compare them with."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, Final, TypeAlias

from star_core import Problem
from star_core.toolkit import suggestion

MISSION: Final = "mission"  # by which `exclude` and `baseline` name missions
POOLED: Final = "seed and mission"  # pair: of all missions together

Levels: TypeAlias = Mapping[str, str]  # by factor


def combinations(data: Mapping[str, Any], mission: str) -> list[dict[str, str]]:
    """Return the combinations of levels at which a mission is flown, the last varying fastest."""
    factors: Mapping[str, Mapping[str, Any]] = data.get("factors", {})
    excluded = data.get("exclude", [])
    every = (dict(zip(factors, names, strict=True)) for names in product(*factors.values()))
    return [
        levels for levels in every
        if not any(_matches(levels | {MISSION: mission}, rule) for rule in excluded)
    ]  # fmt: skip


def problems(data: Mapping[str, Any], missions: Sequence[str]) -> Iterator[Problem]:
    """Yield the problems of what is excluded and compared.

    Args:
        data: The study, which fits the schema.
        missions: Names of its missions, in the order of the study.
    """
    names: dict[str, Collection[str]] = {**data.get("factors", {}), MISSION: missions}
    wrong = [
        *(each for i, rule in enumerate(data.get("exclude", []))
          for each in _unknown(("exclude", i), rule, names)),
        *_unknown(("baseline",), data.get("baseline", {}), names),
    ]  # fmt: skip
    yield from wrong
    if wrong:
        return
    flown = [
        levels | {MISSION: mission}
        for mission in missions
        for levels in combinations(data, mission)
    ]
    for mission in missions:
        if not any(levels[MISSION] == mission for levels in flown):
            why = f"every combination of mission {mission!r} is excluded; remove the mission"
            yield Problem(("exclude",), why, "option-conflict")
    baseline = data.get("baseline", {})
    if flown and not any(_matches(levels, baseline) for levels in flown):
        why = "every such combination is excluded"
        yield Problem(("baseline",), why, "option-conflict")
    if MISSION in baseline and data.get("pair") == POOLED:
        why = f"the missions are pooled by `pair: {POOLED}`, so none of them can be the baseline"
        yield Problem(("baseline", MISSION), why, "option-conflict")


def _matches(levels: Levels, rule: Levels) -> bool:
    return all(levels[name] == level for name, level in rule.items())


def _unknown(
    path: tuple[str | int, ...], rule: Levels, names: Mapping[str, Collection[str]]
) -> Iterator[Problem]:
    """Yield a problem for each factor or level that the study does not have."""
    for name, level in rule.items():
        if name not in names:
            hint = suggestion(name, names, "there are")
            yield Problem((*path, name), f"no factor named {name!r}{hint}", "invalid-value")
        elif level not in names[name]:
            hint = suggestion(level, names[name], "there are")
            kind = "mission" if name == MISSION else f"level of {name!r}"
            yield Problem((*path, name), f"no {kind} named {level!r}{hint}", "invalid-value")
