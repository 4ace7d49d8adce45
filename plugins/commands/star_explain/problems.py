"""What a rehearsal shows to be wrong with a mission, for ``star check``."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import Mission, Problem, Registry
from star_core.toolkit import Rehearsal
from star_explain import MOST_COMPARED, drifts
from star_explain.coverage import coverage_problems
from star_explain.crowds import crowd_problems
from star_explain.drift import drift_problems
from star_explain.goals import goal_problems
from star_explain.jam import jam_problems
from star_explain.near_obstacles import near_obstacle_problems
from star_explain.origins import Origins
from star_explain.parked import parked_problems
from star_explain.results import results, steps_of
from star_explain.variants import MAX_REACTIONS, AllFly, variants


def problems(mission: Mission, registry: Registry) -> Iterator[Problem]:
    """Yield what rehearsals of all variants of a mission find, in the first variant that has it.

    A reaction that comes early can spoil steps of the mission that work if it comes when planned:
    of these, its variant yields warnings.
    """
    reported: set[tuple[tuple[str | int, ...], str]] = set()
    for variant in variants(mission):
        early = next((r for r in variant.reactions if isinstance(r.when, AllFly)), None)
        problems = [
            problem
            for problem in _of_variant(variant, registry)
            if (problem.path, problem.code) not in reported
        ]
        reported |= {(problem.path, problem.code) for problem in problems}
        for problem in problems:
            if early is None or problem.path[: len(early.at)] == early.at:
                yield problem
            else:
                where, _ = early.location.rsplit(":", 1)
                message = f"if the reaction at {where} comes early: {problem.message}"
                yield problem._replace(message=message, warning=True)
    for reaction in mission.reactions[MAX_REACTIONS : MAX_REACTIONS + 1]:
        text = f"this reaction, and all after it, are not rehearsed: only {MAX_REACTIONS} are"
        yield Problem(reaction.at, text, "not-rehearsed", warning=True)


def _of_variant(mission: Mission, registry: Registry) -> Iterator[Problem]:
    """Yield what a rehearsal finds: timeouts, goals, and obstacles in the way of agents or below.

    A task that raises is a warning: it may need what only a flight has.

    If positions drift, also agents that come too near to others, obstacles or fence for that, and
    agents that the margins for it leave no room to pass each other.
    """
    avoider = registry.find("avoider", mission.plugins["avoider"].use).offer
    others = [
        name for name, offer in registry.offers()["planner"].items() if offer.avoids_obstacles
    ]
    hint = f"; use planner {' or '.join(others)}, or waypoints around it" if others else ""
    rehearsal: Rehearsal = registry.manager.hook.star_rehearse(mission=mission, registry=registry)
    origins = Origins(mission, registry, rehearsal)
    for step in steps_of(results(mission, registry, rehearsal, origins)):
        path = (*step.action.path, step.action.verb)
        if step.late:
            text = f"{step.action.verb} {step.fault}" + " in the rehearsal" * (not step.timed)
            at = (*path, "timeout") if step.timed else path
            yield Problem(at, text, "timeout-too-short", warning=not step.timed)
        if step.raised:
            text = f"{step.action.verb} fails in the rehearsal: {step.fault}"
            yield Problem(path, text, "plugin-failed", warning=True)
        for blocked in step.blocked:
            text = f"{blocked}: planner {mission.plugins['planner'].use!r} ignores obstacles{hint}"
            yield Problem(path, text, "path-blocked", warning=avoider.avoids_obstacles)
        for surface in step.surfaces:
            yield Problem(path, surface, "over-obstacle", warning=True)
        yield from goal_problems(step, mission, registry)
    yield from crowd_problems(mission, rehearsal, origins)
    yield from parked_problems(mission, registry, rehearsal)
    yield from near_obstacle_problems(mission, registry, rehearsal)
    yield from coverage_problems(mission, registry, rehearsal)
    if drifts(mission, registry):
        n = len(mission.scene.agents)
        if n <= MOST_COMPARED:
            yield from drift_problems(mission, registry, rehearsal)
        if n > 1 and mission.scene.limits.separation > 0:
            yield from jam_problems(mission, registry, rehearsal)
