"""What a dry run shows to be wrong with a mission, for ``star check``."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import Mission, Problem, Registry
from star_explain.dry_run import Part, StepResult, dry_run


def problems(mission: Mission, registry: Registry) -> Iterator[Problem]:
    """Yield what a dry run finds: timeouts, and obstacles in the way of agents or below them."""
    avoider = registry.find("avoider", mission.parts["avoider"].use).offer
    others = [
        name
        for name in registry.names("planner")
        if registry.find("planner", name).offer.avoids_obstacles
    ]
    hint = f"; use planner {' or '.join(others)}, or waypoints around it" if others else ""
    for result in _steps(dry_run(mission, registry)):
        path = (*result.action.path, result.action.verb)
        if result.late and result.given:
            text = f"{result.action.verb} {result.fault}"
            yield Problem((*path, "timeout"), text, "timeout-too-short")
        for blocked in result.blocked:
            text = f"{blocked}: planner {mission.parts['planner'].use!r} ignores obstacles{hint}"
            yield Problem(path, text, "path-blocked", warning=avoider.avoids_obstacles)
        for surface in result.surfaces:
            yield Problem(path, surface, "over-obstacle", warning=True)


def _steps(part: Part) -> Iterator[StepResult]:
    if isinstance(part, StepResult):
        yield part
    else:
        for inner in part.parts:
            yield from _steps(inner)
