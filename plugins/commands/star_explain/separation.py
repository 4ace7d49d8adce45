"""The distances that agents with exact positions keep from each other and from obstacles."""

from __future__ import annotations

from star_core import Mission, Registry


def kept_distance(mission: Mission) -> float:
    """Return the separation of the mission, or twice its avoider's radius if that is more, m."""
    return max(mission.scene.limits.separation, 2.0 * option(mission, "avoider", "radius"))


def kept_clearance(mission: Mission, registry: Registry) -> float:
    """Return the distance that planner or avoider keep to obstacles, m; 0 if neither does.

    An avoider without a clearance keeps its radius.
    """
    clearances = [0.0]
    for kind in ("planner", "avoider"):
        if registry.find(kind, mission.plugins[kind].use).offer.avoids_obstacles:
            least = option(mission, kind, "radius") if kind == "avoider" else 0.0
            clearances.append(option(mission, kind, "clearance", least))
    return max(clearances)


def option(mission: Mission, kind: str, name: str, default: float = 0.0) -> float:
    """Return a number among the options of a plugin, the default if there is none."""
    value = mission.plugins[kind].options.get(name)
    return float(value) if isinstance(value, int | float) else default
