"""Targets of the world that were found: by which agent, when, and at which position."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from star_core.messages.arrays import Rows, frozen
from star_core.messages.telemetry import Sightings
from star_core.world.scene import Scene

MIN_SIGHTINGS: Final = 3  # images by one agent, after which a target is found: one may be misread


class Targets:
    """Combines the sightings of targets; each target is found once, by one agent.

    A target's position is the mean of all its sightings, weighted by their inverse variances; of
    a target with several tags, that of its first.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.names = tuple(dict.fromkeys(tag.of for tag in scene.world.targets))
        self._of = {tag.id: self.names.index(tag.of) for tag in scene.world.targets}
        self._position = {tag.id: np.array(tag.position) for tag in scene.world.targets}
        first = {tag.of: np.array(tag.position) for tag in reversed(scene.world.targets)}
        self._first = [first[name] for name in self.names]
        self._sightings = np.zeros((len(self.names), len(scene.agents)), np.int64)
        self._off = np.zeros((len(self.names), 3))  # m, sum of weighted errors
        self._weight = np.zeros(len(self.names))  # 1/m²
        self._when = np.full(len(self.names), np.nan)
        self.finder: Rows = frozen(np.full(len(self.names), -1))

    def add(self, sightings: Sightings, time: float) -> list[tuple[str, str]]:
        """Add sightings; return the names of targets found now, and of their finders.

        Args:
            sightings: Of the tick. Other tags than targets' are ignored.
            time: Of the tick, s.
        """
        new = []
        for k, tag in enumerate(sightings.tag.tolist()):
            target = self._of.get(tag)
            spread = np.trace(sightings.covariance[k])
            if target is None or not (0 < spread < np.inf):
                continue
            agent = int(sightings.agent[k])
            self._sightings[target, agent] += 1
            self._off[target] += (sightings.position[k] - self._position[tag]) / spread
            self._weight[target] += 1 / spread
            if self.finder[target] < 0 and self._sightings[target, agent] >= MIN_SIGHTINGS:
                finder = self.finder.copy()
                finder[target] = agent
                self.finder = frozen(finder)
                self._when[target] = time
                new.append((self.names[target], self._scene.agents[agent].name))
        return new

    def summary(self) -> dict[str, Any]:
        """Return ``targets`` of the summary: those that were found, in the order of the world."""
        off = self._off / np.maximum(self._weight, np.finfo(float).tiny)[:, None]
        rows = np.flatnonzero(self.finder >= 0).tolist()
        return {
            "found": len(rows),
            "total": len(self.names),
            "list": [
                {
                    "name": self.names[row],
                    "finder": self._scene.agents[self.finder[row]].name,
                    "time_s": float(self._when[row]),
                    "position_m": (self._first[row] + off[row]).tolist(),
                    "error_m": float(np.linalg.norm(off[row])),
                }
                for row in rows
            ],
        }
