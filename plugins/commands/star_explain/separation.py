"""The distance that two agents with exact positions keep from each other."""

from __future__ import annotations

from star_core import Mission, Registry
from star_core.toolkit import fill_defaults


def kept_distance(mission: Mission, registry: Registry) -> float:
    """Return the separation of the mission, or twice its avoider's radius if that is more, m."""
    avoider = mission.parts["avoider"]
    options = fill_defaults(avoider.options, registry.find("avoider", avoider.use).offer.options)
    radius = options.get("radius", 0.0)
    twice = 2.0 * radius if isinstance(radius, int | float) else 0.0
    return max(mission.scene.limits.separation, twice)
