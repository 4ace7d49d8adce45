"""Planner ``low``: refuses goals above a shelf, before and in flight."""

from star_core import PlannerSpec, Problem, hookimpl


def check_goals(scene, goals, top):  # goals: a list of (x, y, z) in the map, m
    for i, goal in enumerate(goals):
        if goal[2] > top:
            yield Problem((i,), f"is above the shelf, at {top:g} m")


@hookimpl
def star_planners():
    yield PlannerSpec(
        name="low",
        summary="Flies straight, below a shelf.",
        make=make,
        options={
            "type": "object",
            "properties": {"top": {"type": "number", "default": 1.5}},
        },
        check_goals=check_goals,
    )


def make(scene, top):
    from star_gentle.low_planner import Low

    return Low(scene, top)
