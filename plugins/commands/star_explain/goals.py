"""Goals that depend on where agents are, and where none can be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from star_core import Mission, Problem, Registry
from star_explain.results import StepResult

ERROR: Final = 0.1  # m, by which a take-off differs from the rehearsal
AROUND: Final = ((0.0, 0.0), (ERROR, 0.0), (-ERROR, 0.0), (0.0, ERROR), (0.0, -ERROR))


def goal_problems(step: StepResult, mission: Mission, registry: Registry) -> Iterator[Problem]:
    """Yield why the agents of a step cannot fly to goals that only the rehearsal knows.

    It is a warning if the agents may begin elsewhere than in the rehearsal, if the step may end
    before, or if the mission continues after its failure. A goal that follows from where an agent
    took off may be off by `ERROR`: that no agent could fly to it then is a warning too.
    """
    action = step.action
    path = (*action.path, action.verb)
    sure = step.certain and action.until is None and action.on_failure == "abort"
    if step.failed:
        text = f"{action.verb} fails in the rehearsal: {step.fault}"
        yield Problem(path, text, "unreachable-goal", warning=not sure)
        return
    for name, (x, y, z) in zip(step.agents, step.ends, strict=False):
        beside = AROUND[:1] if step.anchored else AROUND
        around = [(float(x) + dx, float(y) + dy, float(z)) for dx, dy in beside]
        faults = _faults(around, mission, registry)
        if not any(faults):
            continue
        first = next(filter(None, faults))
        if faults[0]:
            text = f"{action.verb} leads {name} to a goal that it cannot reach: {first}"
        else:
            text = (
                f"{action.verb} leads {name} to [{x:.2f}, {y:.2f}, {z:.2f}]; it fails {ERROR:g} m "
                f"beside it, and positions are not more exact: {first}"
            )
        yield Problem(path, text, "unreachable-goal", warning=not (sure and faults[0]))
        return


def _faults(
    goals: Sequence[tuple[float, float, float]], mission: Mission, registry: Registry
) -> list[str]:
    """Return why agents cannot fly to goals, empty where they can, one each."""
    planner = mission.plugins["planner"]
    offer = registry.find("planner", planner.use).offer
    faults = [mission.scene.position_fault(goal) or "" for goal in goals]
    if offer.check_goals is not None:
        for problem in offer.check_goals(mission.scene, goals, **planner.options):
            i = int(problem.path[0])
            x, y, z = goals[i]
            faults[i] = faults[i] or f"[{x:.2f}, {y:.2f}, {z:.2f}] {problem.message}"
    return faults
