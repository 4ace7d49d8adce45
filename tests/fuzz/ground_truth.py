"""Judges a flight by where the drones really were, with geometry of its own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from typing import Any, Final, TypeAlias

import numpy as np

from star_core import Tick, hookimpl
from tests.simulators import SimulatorWitness

MAX_COLLISION: Final = 0.12  # m between the centers of two drones that touch
MAX_CONTACT: Final = 0.06  # m between an obstacle and the center of a drone that touches it
MAX_OUTSIDE: Final = 0.2  # m outside of the fence
MAX_IMPACT: Final = 1.0  # m/s
GROUND: Final = 0.15  # m; a drone that descends faster than `MAX_IMPACT` higher up falls
AIRBORNE: Final = 0.1  # m
STUCK_TIME: Final = 20.0  # s that an agent keeps away from its goal without moving
STUCK_RADIUS: Final = 0.1  # m
AWAY: Final = 0.3  # m from its goal
PERIOD: Final = 1.0  # s between the positions compared for that

Form: TypeAlias = Mapping[str, Any]
"""An obstacle as a world file has it."""


def beside(form: Form, point: np.ndarray) -> np.ndarray:
    """Return the horizontal distances of (..., 2) points from an obstacle, 0 inside: (...,) m.

    >>> beside({"cylinder": {"centre": [0, 0], "radius": 1}}, np.array([[3.0, 0], [0, 0.5]]))
    array([2., 0.])
    >>> beside({"box": {"centre": [0, 0], "size": [2, 4]}}, np.array([[2.0, 0], [0, 1]]))
    array([1., 0.])
    >>> wall = {"polyline": [[0, 0], [2, 0]], "thickness": 0.2}
    >>> beside(wall, np.array([[1.0, 1.1]])).round(6)
    array([1.])
    >>> beside({"polygon": [[0, 0], [2, 0], [2, 2], [0, 2]]}, np.array([[1.0, 1], [1, 5]]))
    array([0., 3.])
    """
    if "cylinder" in form:
        center, radius = form["cylinder"]["centre"], form["cylinder"]["radius"]
        apart: np.ndarray = np.maximum(np.linalg.norm(point - center, axis=-1) - radius, 0.0)
        return apart
    if "box" in form:
        box = form["box"]
        return _in_box(point - box["centre"], math.radians(box.get("yaw_deg", 0.0)), box["size"])
    if "polyline" in form:
        nearest: np.ndarray = np.min(
            [_wall(point, *ends, form["thickness"]) for ends in _pairs(form)], axis=0
        )
        return nearest
    return _polygon(np.array(form["polygon"], np.float64), point)


def clearance(form: Form, position: np.ndarray) -> np.ndarray:
    """Return the distances of (..., 3) positions from an obstacle, m."""
    foot, top = form["height"]
    z = position[..., 2]
    above = np.maximum(np.maximum(foot - z, z - top), 0.0)
    distance: np.ndarray = np.hypot(beside(form, position[..., :2]), above)
    return distance


def _pairs(form: Form) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(np.array(a, np.float64), np.array(b, np.float64))
            for a, b in pairwise(form["polyline"])]  # fmt: skip


def _wall(point: np.ndarray, a: np.ndarray, b: np.ndarray, thickness: float) -> np.ndarray:
    """A stretch reaches half a thickness beyond its ends."""
    along = b - a
    size = (float(np.linalg.norm(along)) + thickness, thickness)
    return _in_box(point - (a + b) / 2, math.atan2(along[1], along[0]), size)


def _in_box(offset: np.ndarray, yaw: float, size: Sequence[float]) -> np.ndarray:
    cos, sin = math.cos(yaw), math.sin(yaw)
    x = offset[..., 0] * cos + offset[..., 1] * sin
    y = offset[..., 1] * cos - offset[..., 0] * sin
    return np.hypot(np.maximum(abs(x) - size[0] / 2, 0.0), np.maximum(abs(y) - size[1] / 2, 0.0))


def _polygon(corner: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Distance from the nearest side, or 0 where a ray crosses an odd number of sides."""
    nearest, inside = np.full(point.shape[:-1], np.inf), np.zeros(point.shape[:-1], np.bool_)
    x, y = point[..., 0], point[..., 1]
    for a, b in zip(corner, np.roll(corner, -1, axis=0), strict=True):
        side = b - a
        share = np.clip((point - a) @ side / (side @ side), 0.0, 1.0)
        foot = a + share[..., None] * side
        nearest = np.minimum(nearest, np.linalg.norm(point - foot, axis=-1))
        crosses = (a[1] > y) != (b[1] > y)
        if side[1]:
            inside ^= crosses & (x < a[0] + (y - a[1]) * side[0] / side[1])
    return np.where(inside, 0.0, nearest)


@dataclass
class Witness(SimulatorWitness):
    """Observes a flight: where its drones are, and where they should go.

    Attributes:
        names: Of the agents.
        time: Times, s.
        position: At each time, (N, 3) m.
        climb: At each time, (N,) m/s.
        away: At each time, distance of each agent from its goal; NaN without one.
        estimated: At each time, (N, 3) m.
    """

    names: tuple[str, ...] = ()
    time: list[float] = field(default_factory=list)
    position: list[np.ndarray] = field(default_factory=list)
    climb: list[np.ndarray] = field(default_factory=list)
    away: list[np.ndarray] = field(default_factory=list)
    estimated: list[np.ndarray] = field(default_factory=list)

    @hookimpl
    def star_mission_started(self, flight: Any) -> None:
        self.names = flight.scene.names

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        assert tick.truth is not None
        away = np.linalg.norm(tick.goals.position - tick.estimate.position, axis=1)
        self._add(tick.time, tick.truth, np.where(tick.goals.active, away, np.nan))
        self.estimated.append(tick.estimate.position.copy())

    def reset(self) -> None:
        """Forget the last flight."""
        self.simulator = None
        for table in (self.time, self.position, self.climb, self.away, self.estimated):
            table.clear()

    def watch_on(self, seconds: float = 3.0) -> None:
        """Watch the drones for some more seconds, without the program."""
        if self.simulator is None or not self.time:
            return
        begun, simulator = self.time[-1], type(self.simulator)
        for k in range(1, round(seconds / 0.05)):
            simulator.wait(self.simulator, begun + 0.05 * k)
            truth = simulator.truth(self.simulator)
            self._add(begun + 0.05 * k, truth, np.full(len(self.names), np.nan))

    def _add(self, now: float, truth: Any, away: np.ndarray) -> None:
        self.time.append(now)
        self.position.append(truth.position.copy())
        self.climb.append(truth.velocity[:, 2].copy())
        self.away.append(away)


def judged(witness: Witness, world: Mapping[str, Any], summary: Mapping[str, Any]) -> list[str]:
    """Return what went wrong in a flight, one line each; empty if nothing did."""
    time, position = np.array(witness.time), np.array(witness.position)
    defects: list[str] = []
    if summary["outcome"] != "completed":
        defects.append(f"{summary['outcome']}: {summary['reason']}")
    defects += [
        f"step {step['location']} {step['verb']} of a completed mission: {step['outcome']}"
        for step in summary["steps"]
        if step["outcome"] == "failure" and not defects
    ]
    defects += _collisions(witness.names, time, position)
    for i, name in enumerate(witness.names):
        path, high = position[:, i], position[:, i, 2] > AIRBORNE
        for obstacle, form in world.get("obstacles", {}).items():
            near = np.where(high, clearance(form, path), np.inf)
            if near[k := int(near.argmin())] < MAX_CONTACT:
                defects.append(
                    f"contact: {name}, {near[k]:.2f} m from {obstacle} at {time[k]:.1f} s"
                )
        low, top = (np.array(world["fence"][end]) for end in ("low", "high"))
        outside = np.linalg.norm(np.maximum(np.maximum(low - path, path - top), 0.0), axis=1)
        if outside[k := int(outside.argmax())] > MAX_OUTSIDE:
            defects.append(f"fence: {name}, {outside[k]:.2f} m outside at {time[k]:.1f} s")
        sink = -np.array(witness.climb)[:, i]
        if sink[k := int(sink.argmax())] > MAX_IMPACT:
            what = "impact" if path[k, 2] < GROUND else "fall"
            defects.append(f"{what}: {name}, {sink[k]:.2f} m/s at {time[k]:.1f} s")
        if high[-1]:
            defects.append(f"aloft: {name}, at {path[-1, 2]:.2f} m after the end")
        away = np.where(high, np.array(witness.away)[:, i], np.nan)
        if (begun := _stuck(time, path, away)) is not None:
            defects.append(f"deadlock: {name}, from {begun:.1f} s on")
    return defects


def _collisions(names: Sequence[str], time: np.ndarray, position: np.ndarray) -> list[str]:
    collisions = []
    for i, j in combinations(range(len(names)), 2):
        apart = np.linalg.norm(position[:, i] - position[:, j], axis=1)
        high = (position[:, [i, j], 2] > AIRBORNE).any(axis=1)
        if (apart := np.where(high, apart, np.inf))[k := int(apart.argmin())] < MAX_COLLISION:
            collisions.append(
                f"collision: {names[i]}, {names[j]}, {apart[k]:.2f} m at {time[k]:.1f} s"
            )
    return collisions


def _stuck(time: np.ndarray, path: np.ndarray, away: np.ndarray) -> float | None:
    """Return since when an agent stands still away from its goal, s; None if it never does."""
    ticks = [int(np.searchsorted(time, now)) for now in np.arange(time[0], time[-1], PERIOD)]
    begun = 0
    for k, tick in enumerate(ticks):
        moved = np.linalg.norm(path[tick] - path[ticks[begun]]) > STUCK_RADIUS
        if moved or not away[tick] > AWAY:
            begun = k
        elif (k - begun) * PERIOD >= STUCK_TIME:
            return float(time[ticks[begun]])
    return None
