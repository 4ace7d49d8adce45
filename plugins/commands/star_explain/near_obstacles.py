"""Agents that start or land nearer to an obstacle than planner, avoider and core keep from it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from star_core import AgentPhase, Array, Mission, Obstacle, Problem, Registry
from star_core.toolkit import OBSTACLE_CLEARANCE, Rehearsal
from star_explain.separation import kept_clearance

GROUND: Final = (AgentPhase.GROUNDED, AgentPhase.TAKING_OFF)
ROUNDING: Final = 1e-9  # m
SAME: Final = 0.1  # m in the plane: a landing nearer than this to the agent's start is at its start


def near_obstacle_problems(
    mission: Mission, registry: Registry, rehearsal: Rehearsal
) -> Iterator[Problem]:
    """Warn of starts and landings within the clearance of an obstacle.

    Take-offs and landings are straight lines up and down, on which nothing steers an agent. The
    clearance is the greatest of planner, avoider and `OBSTACLE_CLEARANCE`.
    """
    obstacles = mission.scene.world.obstacles
    if not obstacles:
        return
    kept = max(OBSTACLE_CLEARANCE, kept_clearance(mission, registry))
    for row, agent in enumerate(mission.scene.agents):
        flies = np.flatnonzero(rehearsal.airborne[:, row])
        if not len(flies):
            continue
        start = rehearsal.position[0, row]
        near = _nearest(obstacles, start, _top(rehearsal, row, int(flies[0])))
        if near[0] < kept - ROUNDING:
            yield Problem(
                ("swarm", agent.name, "start"),
                f"{agent.name} starts {near[0]:.2f} m from obstacle {near[1]!r}, nearer than "
                f"{kept:g} m: it may touch it as it takes off and lands",
                "start-near-obstacle",
                warning=True,
            )
        yield from _landings(mission, registry, rehearsal, row, kept)


def _landings(
    mission: Mission, registry: Registry, rehearsal: Rehearsal, row: int, kept: float
) -> Iterator[Problem]:
    agent, obstacles = mission.scene.agents[row], mission.scene.world.obstacles
    start = rehearsal.position[0, row]
    for step in rehearsal.steps:
        spec = registry.find("task", step.action.verb).offer
        if row not in step.rows or spec.after != "ground" or spec.before == "ground":
            continue
        during = rehearsal.during(step)
        place = rehearsal.position[during, row]
        if np.hypot(*(place[-1] - start)[:2]) <= SAME:
            continue
        away, name = _nearest(obstacles, place[-1], float(place[:, 2].max()))
        if away < kept - ROUNDING:
            yield Problem(
                step.action.at,
                f"{agent.name} lands {away:.2f} m from obstacle {name!r}, nearer than {kept:g} m: "
                "it may touch it",
                "landing-near-obstacle",
                warning=True,
            )


def _top(rehearsal: Rehearsal, row: int, first: int) -> float:
    """Return the height at the end of a climb that begins at a moment, m."""
    phase = rehearsal.phase[first:, row]
    climbs = np.flatnonzero(~np.isin(phase, GROUND))
    end = first + (int(climbs[0]) if len(climbs) else len(phase) - 1)
    return float(rehearsal.position[end, row, 2])


def _nearest(obstacles: tuple[Obstacle, ...], foot: Array, top: float) -> tuple[float, str]:
    """Return the least distance of an upright line to an obstacle, m, and the obstacle's name.

    An obstacle below the line, such as a table on which an agent stands, is not beside it.
    """
    x, y, z = foot.tolist()
    low, high = min(z, top), max(z, top)
    distances = [
        (obstacle.distance((x, y, low), high), obstacle.name)
        for obstacle in obstacles
        if obstacle.height[1] > low
    ]
    return min(distances, default=(math.inf, ""))
