"""Measures a flight as it goes, and sums it up."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.events import Event, Tick
from star_core.messages.state import AgentPhase
from star_core.metrics.contacts import Contacts
from star_core.metrics.deadlocks import Deadlocks
from star_core.metrics.targets import Targets
from star_core.scene import Scene

FLYING, LOST = int(AgentPhase.FLYING), int(AgentPhase.LOST)
AT_ONCE = 64
"""Ticks whose errors are judged together: one call costs as much as for one."""


class FlightMetrics:
    """Takes in every tick of a flight.

    The position error is the distance from estimate to truth in space, not
    aligned, from the end of an agent's take-off to the start of its landing. NEES, the mean of that
    error squared over the covariance the localizer gave it, a degree of freedom, is 1 where the
    covariance is right; more means that the localizer is too sure. The path of an agent whose
    position was never known is unknown, and not part of the total.

    Args:
        scene: The agents.
        contacts: Has followed the distances between agents and to obstacles.
    """

    def __init__(self, scene: Scene, contacts: Contacts) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._contacts = contacts
        self._length = np.zeros(n)
        self._placed = np.zeros(n, np.bool_)  # whether a position was ever known
        self._up = np.zeros(n, np.bool_)  # between take-off and landing, lost or not
        self._last: Array | None = None
        self._errors: list[tuple[Mask, Array]] = []
        self._offsets: list[tuple[Array, Array]] = []  # with their covariances, to be judged
        self._worst = 0.0  # m
        self._nees = 0.0
        self._judged = 0
        self._begun: float | None = None
        self._time = 0.0
        self._ticks = 0
        self._corrected = dict.fromkeys(("fence", "speed", "separation"), 0)
        self._deadlocks = Deadlocks(n)

    def add(self, tick: Tick) -> None:
        """Take in one tick."""
        truth = tick.truth
        position = tick.estimate.position if truth is None else truth.position
        if self._last is not None:
            step = position - self._last
            length = np.sqrt(np.vecdot(step, step))
            self._length += np.where(np.isfinite(length), length, 0.0)
        self._placed |= np.isfinite(position).all(axis=1)
        self._last = position
        phase = tick.health.phase
        self._up = (self._up | (phase == FLYING)) & ((phase == FLYING) | (phase == LOST))
        if truth is not None:
            self._err(tick.estimate.position - truth.position, tick.estimate.covariance)
        self._deadlocks.add(tick)
        for why in self._corrected:
            self._corrected[why] += int(getattr(tick.corrected, why).sum())
        self._ticks += 1
        self._begun = tick.time if self._begun is None else self._begun
        self._time = tick.time

    def summary(
        self,
        *,
        mission: str,
        outcome: str,
        reason: str,
        wall_time: float,
        took: Mapping[str, float],
        steps: Sequence[Mapping[str, Any]],
        targets: Targets,
        events: Iterable[Event],
    ) -> dict[str, Any]:
        """Return what ``summary.json`` holds; figures that cannot be known are None.

        Args:
            mission: Its name.
            outcome: How it ended.
            reason: Why it did not complete.
            wall_time: How long it took by the clock on the wall, s.
            took: How long each part computed in all, s.
            steps: What was begun, and how it ended.
            targets: What was found.
            events: Everything that was told.
        """
        names = self._scene.names
        self._judge()
        known = self._placed if self._ticks else ~self._placed
        flight_time = self._time - (self._begun or 0.0)
        mse = self._position_mse()
        return {
            "outcome": outcome,
            "reason": reason,
            "mission": mission,
            "seed": self._scene.seed,
            "agents": list(names),
            "flight_time_s": round(flight_time, 9),
            "wall_time_s": round(wall_time, 6),
            "realtime_factor": round(flight_time / wall_time, 3) if wall_time > 0 else None,
            "compute_us": {
                kind: round(1e6 * seconds / (max(1, self._ticks) * len(names)), 3)
                for kind, seconds in took.items()
            },
            "collisions": {
                "agent_agent": self._contacts.agent_agent,
                "agent_obstacle": self._contacts.agent_obstacle,
            },
            "distances_from": self._contacts.source,
            "deadlocks": self._deadlocks.count,
            "waits": self._deadlocks.waits,
            "corrected": dict(self._corrected),
            "min_separation_m": _known(self._contacts.separation),
            "min_clearance_m": _known(self._contacts.clearance),
            "position_mse_m2": mse,
            "position_rmse_m": None if mse is None else float(np.sqrt(mse["mean"])),
            "position_worst_m": self._worst if self._errors else None,
            "position_nees": self._nees / self._judged if self._judged else None,
            "path_length_m": {
                "total": float(self._length.sum()) if known.any() else None,
                "per_agent": {
                    name: float(length) if there else None
                    for name, length, there in zip(names, self._length, known, strict=True)
                },
            },
            "targets": {
                "found": len(found := targets.found()),
                "total": len(targets.names),
                "list": [
                    {
                        "name": one.name,
                        "finder": one.finder,
                        "time_s": one.time,
                        "position_m": one.position.tolist(),
                        "error_m": one.error,
                    }
                    for one in found
                ],
            },
            "steps": list(steps),
            "events": [
                {key: value for key, value in asdict(event).items() if value is not None}
                for event in events
            ],
        }

    def _position_mse(self) -> Mapping[str, Any] | None:
        """Mean and deviation over all samples of all agents, and the mean of each agent, m²."""
        if not self._errors:
            return None
        flying = np.array([mask for mask, _ in self._errors])  # (T, N)
        squared = np.where(flying, np.array([error for _, error in self._errors]), np.nan)
        samples = squared[flying]
        return {
            "mean": float(np.mean(samples)),
            "std": float(np.std(samples)),
            "per_agent": {
                name: float(np.mean(squared[flying[:, i], i])) if flying[:, i].any() else None
                for i, name in enumerate(self._scene.names)
            },
        }

    def _err(self, offset: Array, covariance: Array) -> None:
        """Take in how far estimates are off: (N, 3) m, with their (N, 3, 3) covariance, m²."""
        counted = self._up & np.isfinite(offset.sum(axis=1))
        if not counted.any():
            return
        squared = np.vecdot(offset, offset)
        self._errors.append((counted, squared))
        self._worst = max(self._worst, float(np.sqrt(squared[counted].max())))
        self._offsets.append((offset[counted], covariance[counted]))
        if len(self._offsets) == AT_ONCE:
            self._judge()

    def _judge(self) -> None:
        """Take in errors squared over what the estimate says they are, a degree of freedom."""
        if not self._offsets:
            return
        offset, covariance = (np.concatenate(column) for column in zip(*self._offsets, strict=True))
        self._offsets.clear()
        known = np.isfinite(offset.sum(axis=1) + covariance.sum(axis=(1, 2)))
        known &= np.linalg.det(covariance) > 0
        if known.any():
            offset = offset[known][..., None]
            squares = offset.transpose(0, 2, 1) @ np.linalg.solve(covariance[known], offset)
            self._nees += float(squares.sum()) / 3
            self._judged += int(known.sum())


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
