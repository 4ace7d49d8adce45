"""The line of a ``follow``: a route at a speed, or a trajectory in its own time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from star_core import Scene
from star_verbs.follow.envelope import place_faults, samples, thinned
from star_verbs.follow.follow import Way
from star_verbs.follow.path import Path
from star_verbs.follow.routes import route, way_faults
from star_verbs.follow.timed_path import TimedPath
from star_verbs.follow.trajectory import read
from star_verbs.slots import slots

Point = tuple[float, float, float]
CATCH_UP = 1.5  # times the path's speed: the speed limit of an agent that lags behind


def along_route(scene: Scene, agents: int, speed: float, **source: Any) -> Way:
    """Return the way of `agents` agents along a file's points or a named path.

    Args:
        scene: The mission's scene.
        agents: Number of agents.
        speed: Along the path, m/s; at most the scene's limit.
        source: Arguments of `route`.

    Raises:
        InputError: The file cannot be used.
    """
    found = route(scene, agents, **source)
    name = source.get("file") or source["path"]
    speed = min(speed, scene.limits.speed)

    def fault(_beside: Sequence[Point]) -> str:
        # Checked again: fewer agents than at the mission's check fly other lines.
        return "; ".join(way_faults(scene, found, name))

    return Way(
        line=Path(found.point, found.yaw_deg),
        length=found.length,
        pace=speed,
        speed=speed,
        fastest=min(CATCH_UP * speed, scene.limits.speed),
        ahead=found.ahead,
        beside=found.beside,
        fault=fault,
    )


def in_its_own_time(
    scene: Scene,
    agents: int,
    spacing: float,
    file: str,
    *,
    timescale: float,
    relative: bool,
    on_board: bool = False,
) -> Way:
    """Return the way of `agents` agents along a trajectory.

    Args:
        scene: The mission's scene.
        agents: Number of agents.
        spacing: Least distance between agents that fly side by side, m.
        file: Name of the trajectory's file in the mission.
        timescale: Factor by which its duration is stretched.
        relative: Whether each agent's trajectory begins at the agent's position; otherwise they lie
            side by side around its position in the map.
        on_board: Whether the agents fly it on board.

    Raises:
        InputError: The file cannot be used.
    """
    trajectory = read(scene.file(file), file)
    looked_at = thinned(samples(trajectory))
    line = TimedPath(trajectory)
    return Way(
        line=line,
        length=trajectory.duration,
        pace=1 / timescale,
        speed=scene.limits.speed,
        fastest=scene.limits.speed,
        ahead=(0.0,) * agents,
        beside=None if relative else slots(agents, (0.0, 0.0, 0.0), spacing),
        fault=lambda shifts: "; ".join(place_faults(scene, looked_at, shifts, file)),
        on_board=line.on_board() if on_board else None,
    )
