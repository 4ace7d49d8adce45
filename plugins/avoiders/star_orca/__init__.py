"""The avoider `orca`: optimal reciprocal collision avoidance in the horizontal plane."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from star_core import AvoiderSpec, deferred, hookimpl
from star_core.toolkit import number, positive

if TYPE_CHECKING:
    from star_core import Problem, Scene

_OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "radius": positive(
            "Half the horizontal distance to keep between two agents, m.", default=0.2
        ),
        "horizon": positive(
            "Time for which no two agents may collide at their velocities, s.", default=2.0
        ),
        "communication_radius": positive(
            "Horizontal distance within which agents are neighbours, m.", default=4.0
        ),
        "max_neighbours": {
            "type": "integer",
            "minimum": 1,
            "maximum": 1000,
            "default": 10,
            "description": "Greatest number of neighbours that are avoided, the nearest first.",
        },
        "obstacles": {
            "enum": ["half-planes", "virtual-agents", "none"],
            "default": "half-planes",
            "description": "How obstacles are avoided: by RVO2's half-planes, as stationary agents "
            "at the nearest point of every visible edge, or not at all.",
        },
        "obstacle_horizon": positive(
            "Time for which no agent may collide with an obstacle, s.", default=1.0
        ),
        "clearance": {
            "type": ["number", "null"],
            "exclusiveMinimum": 0,
            "default": None,
            "description": "Distance to keep from obstacles, m; null is the radius. If it is "
            "larger than the planner's clearance, it blocks agents on the planner's paths.",
        },
        "response": number(
            "Time constant with which agents follow a velocity, s; collisions are "
            "predicted from their positions that much later.",
            minimum=0,
            default=0.3,
        ),
        "uncertainty_margin": {
            "type": ["number", "null"],
            "minimum": 0,
            "default": None,
            "description": "Number of standard deviations of its position by which an agent's "
            "radius is enlarged, at most tripled; 0 treats positions as exact, null is "
            "limits.uncertainty_margin.",
        },
    },
}


@hookimpl
def star_avoiders() -> Iterable[AvoiderSpec]:
    yield AvoiderSpec(
        name="orca",
        summary="Optimal reciprocal collision avoidance in the horizontal plane.",
        make=deferred("star_orca.avoider:Orca"),
        avoids_obstacles=True,
        uncertain_positions=True,
        options=_OPTIONS,
        check=_check,
    )


def _check(scene: Scene, **options: Any) -> Iterable[Problem]:
    """Require neighbours to be detected before they are too near."""
    from star_core import Problem
    from star_core.toolkit import MAX_MARGIN_RATIO

    margin = options["uncertainty_margin"]
    margin = scene.limits.uncertainty_margin if margin is None else margin
    distance, apart = options["communication_radius"], 2 * options["radius"]
    widest = (1 + MAX_MARGIN_RATIO) * apart if margin else apart
    if distance <= widest:
        keep = apart if distance <= apart else widest
        unsure = "" if distance <= apart else " whose positions are uncertain"
        yield Problem(
            ("communication_radius",),
            f"{distance!r} m is not more than {keep:g} m, the distance to keep between two "
            f"agents{unsure}: neighbours would be detected too late",
            warning=distance > apart,
        )
