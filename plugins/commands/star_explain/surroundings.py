"""Obstacles in the way of agents, or below them, in a rehearsal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final

from star_core import AgentPhase, Mission, Registry
from star_core.toolkit import Rehearsal, RehearsedStep
from star_explain import follows_surfaces

BESIDE: Final = 0.2  # m beside what is lower, at which an agent may be above it by its error
ASIDE: Final = 0.4  # m, by a planner that does not know of it, since others push agents aside


class Surroundings:
    """Finds what agents touch, and over what they fly."""

    def __init__(self, mission: Mission, registry: Registry, rehearsal: Rehearsal) -> None:
        self._scene = mission.scene
        self._rehearsal = rehearsal
        planner = registry.find("planner", mission.plugins["planner"].use).offer
        self._ignores_obstacles = not planner.avoids_obstacles
        self._surfaces_matter = follows_surfaces(mission, registry)
        localizer = registry.find("localizer", mission.plugins["localizer"].use).offer
        self._beside = ASIDE if self._ignores_obstacles else BESIDE
        self._corrected, self._least = localizer.corrects_heights, localizer.edge_clearance

    def blocked(self, rounds: Iterable[RehearsedStep]) -> tuple[str, ...]:
        """Return which obstacles agents touch, each where it is touched first.

        None if the planner leads around obstacles.
        """
        by_obstacle: dict[tuple[int, str], str] = {}
        obstacles = self._scene.world.obstacles
        if not self._ignores_obstacles or not obstacles:
            return ()
        for row, (x, y, z) in self._flown(rounds):
            for obstacle in obstacles:
                if (row, obstacle.name) not in by_obstacle and obstacle.touched((x, y, z), z):
                    name = self._scene.agents[row].name
                    where = f"at [{x:.2f}, {y:.2f}, {z:.2f}]"
                    text = f"obstacle {obstacle.name!r} is in the way of {name} {where}"
                    by_obstacle[row, obstacle.name] = text
        return tuple(by_obstacle.values())

    def surfaces(self, rounds: Iterable[RehearsedStep]) -> tuple[str, ...]:
        """Return over which surfaces agents fly that are not as high as those of their starts.

        None if heights are not measured from there; with a localizer that corrects heights, those
        that are too near below.
        """
        if not self._surfaces_matter:
            return ()
        above: dict[tuple[int, str], str] = {}
        beside: dict[tuple[int, str], str] = {}
        for row, point in self._flown(rounds):
            agent = self._scene.agents[row]
            if math.isnan(agent.start[0]):
                continue
            x, y, z = point
            start = self._surface(agent.start)[0]
            height, what = self._surface(point)
            notes = [(height, what, "flies", above)]
            notes += [
                (obstacle.height[1], f"obstacle {obstacle.name!r}", "may fly", beside)
                for obstacle in self._scene.world.obstacles
                if start <= height < obstacle.height[1] < z
                and obstacle.gaps((x, y, obstacle.height[1]))[0] < self._beside
            ]
            for height, what, flies, noted in notes:
                climbs = height - start
                least = self._least * abs(climbs)
                if self._corrected and z - max(height, start) < least:
                    effect = (
                        f"at the edge it sinks for a moment; fly {least:.2f} m above it or more"
                    )
                elif climbs != 0.0 and not self._corrected:
                    effect = f"it {'climbs' if climbs > 0 else 'sinks'} by {abs(climbs):.2f} m"
                else:
                    continue
                where = f"{agent.name} {flies} over {what} at [{x:.2f}, {y:.2f}, {z:.2f}]"
                text = f"{where}, from where a ranger measures its height: {effect}"
                noted.setdefault((row, what), text)
        return tuple((beside | above).values())

    def _flown(
        self, rounds: Iterable[RehearsedStep]
    ) -> Iterator[tuple[int, tuple[float, float, float]]]:
        """Yield the row and the position of agents that fly, moment by moment, where it changes."""
        rehearsal = self._rehearsal
        for step in rounds:
            during = rehearsal.during(step)
            flies = rehearsal.phase[during] == AgentPhase.FLYING
            last: dict[int, tuple[float, float, float]] = {}
            for position, flying in zip(rehearsal.position[during], flies, strict=True):
                for row in step.rows:
                    x, y, z = position[row].tolist()
                    if flying[row] and last.get(row) != (x, y, z):
                        last[row] = x, y, z
                        yield row, (x, y, z)

    def _surface(self, point: tuple[float, float, float]) -> tuple[float, str]:
        """Return the height of the surface below a point, m, and what it is."""
        below = self._scene.world.below(point)
        if below is None:
            return 0.0, "the floor"
        return below.height[1], f"obstacle {below.name!r}"
