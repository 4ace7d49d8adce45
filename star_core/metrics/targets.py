"""Targets of the world that were found: by which agent, when, and at which position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Rows
from star_core.messages.vision import Sightings
from star_core.scene import Scene

SURE: Final = 3
"""Images of a target that an agent must have seen for it to count as found: one may be misread."""


@dataclass(frozen=True, slots=True)
class Found:
    """A target that was found.

    Attributes:
        name: As the world calls it.
        finder: The agent that found it.
        time: When that was, mission time, s.
        position: (3,) where it seems to be, map frame, m.
        error: How far that is from where it is, m.
    """

    name: str
    finder: str
    time: float
    position: Array
    error: float


class Targets:
    """Keeps what the agents saw of targets; each target is found once, by one agent.

    A target's place is the mean of all that was seen of it, each sighting weighed by the inverse of
    its variance; of a target with several tags, the place of its first.

    Args:
        scene: With the world whose targets are to be found.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.names = tuple(dict.fromkeys(tag.of for tag in scene.world.targets))
        self._of = {tag.id: self.names.index(tag.of) for tag in scene.world.targets}
        self._place = {tag.id: np.array(tag.position) for tag in scene.world.targets}
        first = {tag.of: np.array(tag.position) for tag in reversed(scene.world.targets)}
        self._first = [first[name] for name in self.names]
        self._seen = np.zeros((len(self.names), len(scene.agents)), np.int64)
        self._off = np.zeros((len(self.names), 3))  # m, sum of weighed errors
        self._weight = np.zeros(len(self.names))  # 1/m²
        self._when = np.full(len(self.names), np.nan)
        self.finder: Rows = np.full(len(self.names), -1)

    def see(self, sightings: Sightings, time: float) -> list[tuple[str, str]]:
        """Take in what was seen; return the names of targets that are new, and of their finders.

        Args:
            sightings: Of the tick. What is no target is passed over.
            time: Of the tick, s.
        """
        new = []
        for k, tag in enumerate(sightings.tag.tolist()):
            target = self._of.get(tag)
            spread = np.trace(sightings.covariance[k])
            if target is None or not (0 < spread < np.inf):
                continue
            agent = int(sightings.agent[k])
            self._seen[target, agent] += 1
            self._off[target] += (sightings.position[k] - self._place[tag]) / spread
            self._weight[target] += 1 / spread
            if self.finder[target] < 0 and self._seen[target, agent] >= SURE:
                self.finder = self.finder.copy()
                self.finder[target] = agent
                self._when[target] = time
                new.append((self.names[target], self._scene.agents[agent].name))
        return new

    def found(self) -> list[Found]:
        """Every target that was found, in the order of the world."""
        off = self._off / np.maximum(self._weight, np.finfo(float).tiny)[:, None]
        return [
            Found(
                name=name,
                finder=self._scene.agents[self.finder[i]].name,
                time=float(self._when[i]),
                position=self._first[i] + off[i],
                error=float(np.linalg.norm(off[i])),
            )
            for i, name in enumerate(self.names)
            if self.finder[i] >= 0
        ]
