"""The summary of a flight, measured tick by tick."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np

from star_core.geometry.neighbours import Pairs
from star_core.messages.arrays import Array, Mask, every, some
from star_core.messages.events import Corrected, Event, Tick
from star_core.messages.state import AgentPhase
from star_core.metrics.conflicts import WAITING_DISTANCE, Contacts, Deadlocks
from star_core.metrics.jams import Jams
from star_core.metrics.targets import Targets
from star_core.scene import Scene

FLYING, LOST = int(AgentPhase.FLYING), int(AgentPhase.LOST)
NEES_BATCH: Final = 64  # ticks whose errors are normalized together: one call costs as for one
REPORT_INTERVAL: Final = 1.0  # s without a correction, after which the next one is reported again

CORRECTIONS: Final = {
    "fence": "is held inside the fence",
    "speed": "is slowed to the speed limit",
    "separation": "brakes for another agent",
    "obstacle": "brakes early for an obstacle or the fence, since its position is uncertain",
}
"""Texts of events about agents whose setpoints the safety filter corrects, by the reason."""

NO_TRUTH: Final = "no ground truth: separation and collisions are computed from estimated positions"


class FlightMetrics:
    """Measures every tick of a flight.

    The position error is the distance in space between estimate and ground truth, unaligned, from
    the end of an agent's take-off to the start of its landing. NEES, the mean of the squared error
    over the covariance of the estimate per degree of freedom, is 1 if the covariance is right;
    a localizer with a greater value is overconfident. The path of an agent whose position was never
    known is unknown, and not part of the total.

    Args:
        scene: The agents.

    Attributes:
        contacts: Collisions and closest approaches so far.
    """

    def __init__(self, scene: Scene) -> None:
        n = len(scene.agents)
        self._scene = scene
        self.contacts = Contacts(scene)
        self._deadlocks = Deadlocks(n)
        self._jams = Jams(scene)
        self._length = np.zeros(n)  # m
        self._located = np.zeros(n, np.bool_)  # whether a position was ever known
        self._up = np.zeros(n, np.bool_)  # between take-off and landing, lost or not
        self._last: Array | None = None  # (N, 3) positions in the previous tick, m
        self._errors: list[tuple[Mask, Array]] = []  # (N,) squared, m²
        self._offsets: list[tuple[Array, Array]] = []  # with their covariances, for NEES
        self._worst = 0.0  # m
        self._nees = 0.0
        self._normalized = 0
        self._begun: float | None = None  # s
        self._time = 0.0  # s
        self._ticks = 0
        self._corrected = dict.fromkeys(CORRECTIONS, 0)
        self._corrected_at = {why: np.full(n, -np.inf) for why in CORRECTIONS}  # s
        self._reported_no_truth = False

    @property
    def reach(self) -> float:
        """Distance within which pairs of agents matter by their estimated positions, m."""
        return max(WAITING_DISTANCE, self.contacts.reach)

    def add(self, tick: Tick, near: Pairs) -> list[Event]:
        """Measure one tick; return the events to report.

        Args:
            tick: Of the flight.
            near: Pairs of agents within `reach`, at least, by estimated positions.
        """
        truth, events = tick.truth, self._corrections(tick.time, tick.corrected)
        position = tick.estimate.position if truth is None else truth.position
        if self._last is not None:
            step = position - self._last
            length = np.sqrt(np.vecdot(step, step))
            known = np.isfinite(length)
            self._length += length if every(known) else np.where(known, length, 0.0)
        if not every(self._located):
            self._located |= np.isfinite(position).all(axis=1)
        self._last = position
        phase = tick.health.phase
        flying = phase == FLYING
        self._up = flying | (self._up & (phase == LOST))
        self._deadlocks.add(tick, near)
        if jam := self._jams.add(tick, near):
            events.append(jam)
        if truth is not None:
            self._add_errors(tick.estimate.position - truth.position, tick.estimate.covariance)
            near = Pairs.of(truth.position, self.contacts.reach)
        elif not self._reported_no_truth:
            self._reported_no_truth = True
            events.append(Event(tick.time, "no_truth", NO_TRUTH))
        self._ticks += 1
        self._begun = tick.time if self._begun is None else self._begun
        self._time = tick.time
        return events + self.contacts.update(tick, near)

    def _corrections(self, time: float, corrected: Corrected) -> list[Event]:
        """Count corrected setpoints; return an event for each agent when they begin."""
        events = []
        for reason, text in CORRECTIONS.items():
            rows = getattr(corrected, reason)
            if not some(rows):
                continue
            self._corrected[reason] += int(rows.sum())
            since = time - self._corrected_at[reason]
            self._corrected_at[reason][rows] = time
            for row in np.flatnonzero(rows & (since > REPORT_INTERVAL)).tolist():
                name = self._scene.agents[row].name
                events.append(Event(time, "corrected", f"{name} {text}", name))
        return events

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
        """Return the contents of ``summary.json``; unknown figures are None.

        Args:
            mission: Its name.
            outcome: Of the mission.
            reason: Why it did not complete.
            wall_time: Duration in wall time, s.
            took: Computing time of each kind of plugin, s.
            steps: That began, with their outcomes.
            targets: That were found.
            events: Of the flight.
        """
        names = self._scene.names
        self._add_nees()
        known = self._located if self._ticks else ~self._located
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
                "agent_agent": self.contacts.agent_agent,
                "agent_obstacle": self.contacts.agent_obstacle,
            },
            "distances_from": self.contacts.source,
            "deadlocks": self._deadlocks.count,
            "waits": self._deadlocks.waits,
            "jams": self._jams.count,
            "corrected": dict(self._corrected),
            "min_separation_m": _known(self.contacts.separation),
            "min_clearance_m": _known(self.contacts.clearance),
            "position_mse_m2": mse,
            "position_rmse_m": None if mse is None else float(np.sqrt(mse["mean"])),
            "position_worst_m": self._worst if self._errors else None,
            "position_nees": self._nees / self._normalized if self._normalized else None,
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
        """Return mean and deviation over all agents, and the mean of each agent, m²."""
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

    def _add_errors(self, offset: Array, covariance: Array) -> None:
        """Add the (N, 3) errors of an estimate, m, with their (N, 3, 3) covariance, m²."""
        if not some(self._up):
            return
        counted = self._up & np.isfinite(offset).all(axis=1)
        if not some(counted):
            return
        squared = np.vecdot(offset, offset)
        self._errors.append((counted, squared))
        worst = max(squared.tolist()) if every(counted) else float(squared[counted].max())
        self._worst = max(self._worst, math.sqrt(worst))
        self._offsets.append((offset[counted], covariance[counted]))
        if len(self._offsets) == NEES_BATCH:
            self._add_nees()

    def _add_nees(self) -> None:
        """Add the squared errors of some ticks, normalized by their covariances."""
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
            self._normalized += int(known.sum())


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
