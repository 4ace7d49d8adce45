"""The avoider `orca`: optimal reciprocal collision avoidance in the horizontal plane."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from star_core import Offer, hookimpl

if TYPE_CHECKING:
    from star_core import Avoider, Problem, Scene

_OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "radius": {
            "type": "number",
            "exclusiveMinimum": 0,
            "default": 0.2,
            "description": "Half the distance that two agents keep, m",
        },
        "horizon": {
            "type": "number",
            "exclusiveMinimum": 0,
            "default": 2.0,
            "description": "Time for which no two agents shall collide, s",
        },
        "communication_radius": {
            "type": "number",
            "exclusiveMinimum": 0,
            "default": 4.0,
            "description": "How far away in the plane neighbours are looked for, m",
        },
        "max_neighbours": {
            "type": "integer",
            "minimum": 1,
            "maximum": 1000,
            "default": 10,
            "description": "No more than so many neighbours are avoided, the nearest",
        },
        "vertical": {
            "type": "number",
            "exclusiveMinimum": 0,
            "default": 0.6,
            "description": "Agents further apart in height than this do not avoid each other, m",
        },
        "obstacles": {
            "enum": ["half-planes", "virtual-agents", "none"],
            "default": "half-planes",
            "description": "How obstacles are avoided: by RVO2's half-planes, as agents that stand "
            "still at the nearest point of every visible edge, or not at all",
        },
        "obstacle_horizon": {
            "type": "number",
            "exclusiveMinimum": 0,
            "default": 1.0,
            "description": "Time for which no agent shall collide with an obstacle, s",
        },
        "clearance": {
            "type": ["number", "null"],
            "exclusiveMinimum": 0,
            "default": None,
            "description": "Distance that agents keep to obstacles; null is the radius. With more "
            "than the planner's clearance agents are held on the planner's paths, m",
        },
        "response": {
            "type": "number",
            "minimum": 0,
            "default": 0.3,
            "description": "Time constant with which agents follow a velocity: where they will be "
            "so much later is what counts, s",
        },
        "deviations": {
            "type": "number",
            "minimum": 0,
            "default": 0.0,
            "description": "By how many standard deviations of its place an agent's radius is "
            "larger, but no more than doubled; 0 takes every place for exact",
        },
    },
}


@hookimpl
def star_avoiders() -> Iterable[Offer[Avoider]]:
    yield Offer(
        name="orca",
        summary="Optimal reciprocal collision avoidance in the horizontal plane.",
        make=_make,
        options=_OPTIONS,
        check=_check,
    )


def _make(scene: Scene, **options: Any) -> Avoider:
    from star_orca.avoider import Orca

    return Orca(scene, **options)


def _check(_scene: Scene, **options: Any) -> Iterable[Problem]:
    """Refuse to see neighbours only once they are too near."""
    from star_core import Problem

    defaults = {name: schema["default"] for name, schema in _OPTIONS["properties"].items()}
    chosen = defaults | options
    widest = (2 if chosen["deviations"] else 1) * chosen["radius"]
    distance, apart = chosen["communication_radius"], 2 * widest
    if distance <= apart:
        yield Problem(
            ("communication_radius",),
            f"{distance!r} m is not more than {apart:g} m, which two agents may keep apart: "
            "neighbours would be seen too late",
        )
