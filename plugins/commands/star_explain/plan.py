"""The steps of a mission as a numbered plan."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import Registry
from star_explain.rehearsal import Group, Part, Told
from star_explain.words import condition, left_out, options, seconds


def plan(told: Group, registry: Registry) -> Iterator[str]:
    """Yield the lines of a plan."""
    yield f"plan: {times(told)}"
    yield from _steps(told, "", registry)


def times(part: Part) -> str:
    """Return how long a step takes, and at most."""
    takes = f"about {seconds(part.takes)}" if part.takes is not None else "as long as it takes"
    if part.limit is None:
        return f"{takes}, time-out not known"
    given = " (given)" if isinstance(part, Told) and part.given else ""
    return f"{takes}, at most {seconds(part.limit)}{given}"


def alike(group: Group) -> Group | None:
    """Return the steps of the first branch if all do the same in the same time, as ``each`` may."""
    branches = [part for part in group.parts if isinstance(part, Group) and part.times == 1]
    groups = group.at_once and len(branches) == len(group.parts)
    if groups and len({_lines(branch) for branch in branches}) == 1:
        return branches[0]
    return None


def how(group: Group, above: Group) -> str:
    """Return how the steps of a group are done, or from which file they are."""
    if group.times > 1:
        return f"{group.times} times one after the other"
    if group.file and group.file != above.file:
        return f"from {group.file}"
    return "at once" if group.at_once else "one after the other"


def whose(part: Part) -> tuple[str, ...]:
    """Return the names of all agents of a step, each once."""
    if isinstance(part, Told):
        return part.agents
    return tuple(dict.fromkeys(name for inner in part.parts for name in whose(inner)))


def ending(told: Told) -> list[str]:
    """Return who flies a step, what ends it beside itself and its time-out, what a failure does."""
    until = [f"until {condition(told.action.until)}"] if told.action.until is not None else []
    what = {"land": "its agents land", "continue": "the next step begins"}
    on_board = ["flown on board: neither planner nor avoider steers"] if told.on_board else []
    return (
        on_board
        + until
        + [
            f"if it fails, {what[told.action.on_failure]}"
            for _ in range(told.action.on_failure != "abort")
        ]
    )


def _lines(part: Part) -> tuple[tuple[str, str], ...]:
    """Return every step as its place and what is said of its times."""
    if isinstance(part, Told):
        return ((part.action.place, times(part)),)
    return tuple(line for inner in part.parts for line in _lines(inner))


def _steps(group: Group, number: str, registry: Registry) -> Iterator[str]:
    for i, part in enumerate(group.parts, start=1):
        here = f"{number}{i}"
        indent = "  " * (here.count(".") + 1)
        if isinstance(part, Told):
            yield from _step(part, here, indent, registry)
        elif (same := alike(part)) is not None:
            yield f"{indent}{here}  each by itself, {', '.join(whose(part))}: {times(part)}"
            yield from _steps(same, f"{here}.", registry)
        else:
            yield f"{indent}{here}  {how(part, group)}: {times(part)}"
            yield from _steps(part, f"{here}.", registry)


def _step(told: Told, number: str, indent: str, registry: Registry) -> Iterator[str]:
    given = options(told.action.options)
    who = ", ".join(told.agents) or "nobody"
    yield f"{indent}{number}  {told.action.verb} {who}{f'  {given}' if given else ''}"
    inside = indent + " " * (len(number) + 2)
    schema = registry.find("task", told.action.verb).offer.options
    alone = schema.get("outside", {}).get("unless") in told.action.options  # the rest is for others
    if not alone and (rest := options(left_out(told.action.options, schema))):
        yield f"{inside}by default {rest}"
    yield f"{inside}{'; '.join([times(told), *ending(told)])}"
    if told.fault:
        yield f"{inside}! in rehearsal: {told.fault}"
