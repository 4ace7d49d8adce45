"""A recorded flight as a plugin reads it: tables over ticks and agents, summary, world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from star_core.errors import InputError
from star_core.messages.arrays import Array, Mask, Rows
from star_core.messages.state import AgentPhase
from star_core.messages.telemetry import Detections
from star_core.plugin_support.registry import Registry
from star_core.world.scene import Agent
from star_core.world.world import World


@dataclass(frozen=True)
class PlannedPaths:
    """The arrays of ``paths.npz``: K points in the map, those of a path in consecutive rows.

    Attributes:
        time: (K,) mission time from which the path holds, until the next of its agent, s.
        agent: (K,) row of the agent.
        point: (K, 3) m. The agent's own position, where a path begins, is not among the points;
            one point of NaN if the agent has no path.
    """

    time: Array
    agent: Rows
    point: Array

    @classmethod
    def none(cls) -> PlannedPaths:
        """Return a table without a path."""
        return cls(np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 3)))

    def current(self, agent: int, times: Array) -> Rows:
        """Return (M,) the numbers of an agent's paths at (M,) mission times, s; -1: none."""
        rows = np.flatnonzero(self.agent == agent)
        numbers: Rows = np.append(-1, rows)[np.searchsorted(self.time[rows], times, side="right")]
        exists = np.isfinite(np.append(self.point[:, 0], np.nan))[numbers]  # the last: of -1
        return np.where(exists, numbers, -1)

    def points(self, number: int) -> Array:
        """Return the points of a path, (K, 3) m."""
        begin = int(np.searchsorted(self.time, self.time[number]))
        of_agent = self.agent[begin : number + 1] == self.agent[number]
        points: Array = self.point[begin : number + 1][of_agent]
        return points


@dataclass(frozen=True, repr=False)
class Run:
    """A recorded flight; `docs/record.md` describes its files.

    Attributes:
        folder: Where it is.
        manifest: The mission and world as flown, plugins, seed, packages.
        summary: Outcome, figures, steps and events, with the content of ``timing.json``.
        arrays: The arrays of ``trajectory.npz`` by name, over ticks and agents, map frame, SI.
        detections: All tags detected in images.
        paths: Planned paths.
        timing: The arrays of ``timing.npz`` by name, over ticks, s; empty without that file.
        agents: Name of the agent in each row.
        swarm: The agents with their starts and cameras, as the mission has them.
        world: Geofence, obstacles, landmarks and targets.
    """

    folder: Path
    manifest: Mapping[str, Any]
    summary: Mapping[str, Any]
    arrays: Mapping[str, Array]
    detections: Detections
    paths: PlannedPaths
    timing: Mapping[str, Array]
    agents: tuple[str, ...]
    swarm: tuple[Agent, ...]
    world: World

    def in_flight(self) -> Mask:
        """Return when each agent is between take-off and landing, (T, N); also while it is lost."""
        phase = self.arrays["phase"]
        flying, lost = phase == AgentPhase.FLYING, phase == AgentPhase.LOST
        mask: Mask = np.zeros(flying.shape, np.bool_)
        up = np.zeros(flying.shape[1], np.bool_)
        for t in range(len(phase)):
            mask[t] = up = flying[t] | (up & lost[t])
        return mask

    def images(self, agent: str) -> dict[int, Path]:
        """Return the saved images of an agent by their times, ms."""
        return {}


def read_run(folder: Path | str, *, flown: bool = False) -> Run:
    """Return a recorded flight; of one whose program was killed, what was recorded until then.

    The outcome of the latter is ``interrupted``.

    Args:
        folder: Of the run, such as ``runs/latest``.
        flown: Whether to refuse a run that was not started, and so has no arrays.

    Raises:
        InputError: It holds no complete record, or no tick if it must have been `flown`.

    Example:
        >>> run = read_run("runs/latest")  # doctest: +SKIP
        >>> run.arrays["estimate_position"][-1]  # doctest: +SKIP
    """
    folder, registry = Path(folder), _registry()
    run: Run | None = registry.manager.hook.star_read_run(folder=folder, registry=registry)
    if run is None:
        raise InputError(f"{folder}: no installed plugin reads it", "no-record")
    if flown and not run.arrays:
        why = run.summary["reason"] or "it ended before the first tick"
        raise InputError(f"{folder}: no flight was recorded: {why}", "no-record")
    return run


@cache
def _registry() -> Registry:
    """Return the installed plugins, once for all records."""
    return Registry()
