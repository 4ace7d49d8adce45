"""Goals that the planner refuses, before the flight and in flight. Does not import numpy."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from star_core import World

Point = tuple[float, float, float]

ROUNDING = 5e-4  # m: tolerance for goals at the clearance, which are sums of floats


def refusal(
    world: World,
    goal: Point,
    *,
    clearance: float,
    vertical_clearance: float,
    tolerance: float = ROUNDING,
) -> str | None:
    """Return why a goal is refused, to follow "goal [x, y, z]"; None if it is accepted.

    A goal is refused if it is nearer to an obstacle than the clearance and at the same time nearer
    than the vertical clearance above or below it. Distances are exact.

    Args:
        world: World with the obstacles.
        goal: Map frame, m.
        clearance: Least horizontal distance to an obstacle, m.
        vertical_clearance: Least vertical distance to an obstacle, m.
        tolerance: Permitted shortfall of these distances, m.
    """
    beside, above = (max(least - tolerance, 0.0) for least in (clearance, vertical_clearance))
    near = []
    for obstacle in world.obstacles:
        if not obstacle.is_near(goal, beside, above):
            continue
        away, off = obstacle.gaps(goal)
        if not away and not off:
            return f"is inside obstacle {obstacle.name!r}"
        if away < beside and off < above:
            near.append((away, off, obstacle))
    if not near:
        return None
    away, off, obstacle = min(near, key=lambda gap: gap[:2])
    if away > 0:
        distance, kind, kept = f"{away:.3g} m from", "", clearance
    else:
        side = "above" if goal[2] > obstacle.height[0] else "below"
        distance, kind, kept = f"{off:.3g} m {side}", "vertical ", vertical_clearance
    return (
        f"is {distance} obstacle {obstacle.name!r}, less than planner visibility's "
        f"{kind}clearance of {kept:g} m"
    )
