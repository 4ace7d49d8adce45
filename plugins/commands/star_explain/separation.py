"""The distance that two agents with exact positions keep from each other."""

from __future__ import annotations

from star_core import Mission


def kept_distance(mission: Mission) -> float:
    """Return the separation of the mission, or twice its avoider's radius if that is more, m."""
    avoider = mission.plugins["avoider"]
    radius = avoider.options.get("radius", 0.0)
    twice = 2.0 * radius if isinstance(radius, int | float) else 0.0
    return max(mission.scene.limits.separation, twice)
