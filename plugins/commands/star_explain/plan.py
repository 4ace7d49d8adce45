"""The steps of a mission as a numbered plan."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import Registry, TaskSpec
from star_core.toolkit import shortlist
from star_explain.results import Group, Part, StepResult
from star_explain.words import left_out, options, own_options, seconds


def plan(result: Group, registry: Registry) -> Iterator[str]:
    """Yield the lines of a plan."""
    yield f"plan: {times(result)}"
    yield from _steps(result, "", registry)


def times(part: Part) -> str:
    """Return the expected and the greatest duration of a step."""
    takes = f"about {seconds(part.takes)}" if part.takes is not None else "as long as it takes"
    if part.limit is None:
        return f"{takes}, timeout unknown"
    by_user = " (given)" if isinstance(part, StepResult) and part.timed else ""
    return f"{takes}, at most {seconds(part.limit)}{by_user}"


def alike(group: Group) -> Group | None:
    """Return the steps of the first branch if all branches are equal, as ``each`` may produce."""
    branches = [part for part in group.parts if isinstance(part, Group) and part.times == 1]
    groups = group.at_once and not group.title and len(branches) == len(group.parts)
    if groups and len({_lines(branch) for branch in branches}) == 1:
        return branches[0]
    return None


def how(group: Group, above: Group) -> str:
    """Return how the steps of a group run, or from which file they are."""
    if group.title:
        return group.title
    if group.times > 1:
        return f"{group.times} times one after the other"
    if group.file and group.file != above.file:
        return f"from {group.file}"
    return "at once" if group.at_once else "one after the other"


def agent_names(part: Part) -> tuple[str, ...]:
    """Return the names of all agents of a step, each once."""
    if isinstance(part, StepResult):
        return part.agents
    return tuple(dict.fromkeys(name for inner in part.parts for name in agent_names(inner)))


def ending(result: StepResult) -> Iterator[str]:
    """Yield how a step is flown, what ends it besides itself, and what its failure causes."""
    if result.on_board:
        yield "flown on board: neither planner nor avoider steers"
    if result.action.until is not None:
        yield f"until {result.action.until}"
    if result.action.on_failure != "abort":
        what = {"land": "its agents land", "continue": "the next step begins"}
        yield f"if it fails, {what[result.action.on_failure]}"


def _lines(part: Part) -> tuple[tuple[str, str], ...]:
    """Return every step with its number and its durations."""
    if isinstance(part, StepResult):
        return ((part.action.location, times(part)),)
    return tuple(line for inner in part.parts for line in _lines(inner))


def _steps(group: Group, number: str, registry: Registry) -> Iterator[str]:
    for i, part in enumerate(group.parts, start=1):
        label = f"{number}{i}"
        indent = "  " * (label.count(".") + 1)
        if isinstance(part, StepResult):
            yield from _step(part, label, indent, registry)
        elif (same := alike(part)) is not None:
            yield f"{indent}{label}  each by itself, {shortlist(agent_names(part))}: {times(part)}"
            yield from _steps(same, f"{label}.", registry)
        else:
            yield f"{indent}{label}  {how(part, group)}: {times(part)}"
            yield from _steps(part, f"{label}.", registry)


def _step(result: StepResult, number: str, indent: str, registry: Registry) -> Iterator[str]:
    written = options(own_options(result.action))
    names = shortlist(result.agents) or "no agents"
    yield f"{indent}{number}  {result.action.verb} {names}{f'  {written}' if written else ''}"
    inside = indent + " " * (len(number) + 2)
    spec: TaskSpec = registry.find("task", result.action.verb).offer
    # A step without exclusive resources does not use the options for them.
    alone = spec.exclusive is not None and spec.exclusive.unless in result.action.written
    if not alone and (rest := options(left_out(result.action.written, spec.options))):
        yield f"{inside}by default {rest}"
    yield f"{inside}{'; '.join([times(result), *ending(result)])}"
    for fault in (result.fault, *result.blocked):
        if fault:
            yield f"{inside}! in the rehearsal: {fault}"
