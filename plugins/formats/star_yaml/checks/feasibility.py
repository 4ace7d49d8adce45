"""Whether a mission's limits, distances, starts and climbs leave room to fly in its world."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Final

from star_core import Fence, Problem, Registry, Scene
from star_core.formats import JOIN, Point
from star_core.toolkit import CONTACT_RADIUS, Action
from star_yaml.document import Document, unknown_name
from star_yaml.schema import Incomplete

MAX_STAND: Final = 0.15  # m: height of an agent's centre above what it stands on


@dataclass(frozen=True, slots=True)
class Room:
    """The room that a mission leaves its agents.

    Attributes:
        document: The mission as read.
        data: Its `sound_parts`.
        scene: What it describes.
        registry: Registry of the plugins.
    """

    document: Document
    data: Mapping[str, Any]
    scene: Scene
    registry: Registry

    def boundless(self) -> Room:
        """Return the same without limits, for problems that do not follow from them."""
        limits = replace(self.scene.limits, height=(-math.inf, math.inf), separation=0.0)
        return replace(self, scene=replace(self.scene, limits=limits))

    def limits(self) -> Iterator[Problem]:
        """Yield limits within which nothing can fly, and distances wider than the world."""
        (low, high), fence = self.scene.limits.height, self.scene.world.fence
        path = ("limits", "height") if self._is_given("limits", "height") else ("world",)
        if low >= high:
            yield Problem(path, f"lowest {low!r} is not below highest {high!r}", "empty-range")
        elif max(low, fence.low[2]) >= min(high, fence.high[2]):
            yield Problem(
                path,
                f"no height to fly at is inside the fence: they are from {low:g} to {high:g} m, "
                f"and the fence from {fence.low[2]:g} to {fence.high[2]:g} m",
                "empty-range",
            )
        wide = math.dist(fence.low, fence.high)
        (radius, name), separation = self._radius(), self.scene.limits.separation
        distances = {
            ("avoider", "radius"): (2 * radius, f"twice {name} ({2 * radius:g} m)"),
            ("limits", "separation"): (separation, f"a separation of {separation:g} m"),
        }
        for path, (distance, what) in distances.items():
            if len(self.scene.agents) > 1 and distance > wide:
                message = f"{what} is wider than the fence, {wide:.2f} m across"
                yield Problem(path, message, "out-of-range")

    def separation(self) -> Iterator[Problem]:
        """Warn of a separation at which the core brakes agents before the avoider steers them."""
        (radius, name), separation = self._radius(), self.scene.limits.separation
        if len(self.scene.agents) > 1 and "." in name and separation > 2 * radius:
            message = (
                f"limits.separation, {separation:g} m, is more than twice {name}, {2 * radius:g} m:"
                " agents brake before the avoider steers them apart"
            )
            yield Problem(("limits", "separation"), message, "option-conflict", warning=True)

    def starts(self) -> Iterator[Problem]:
        """Yield starts that are impossible, or too close to each other."""
        scene = self.scene
        for agent in scene.agents:
            fault = scene.world.fault(agent.start)
            if fault is not None and "start" in self.data["swarm"][agent.name]:
                path = ("swarm", agent.name, "start")
                yield Problem(path, f"start {fault}", position_code(scene, agent.start))
            elif self._in_air(agent.start):
                start = ", ".join(f"{value:g}" for value in agent.start)
                message = f"{agent.name!r} starts in the air: nothing is below [{start}]"
                yield Problem(("swarm", agent.name, "start"), message, "start-in-air", warning=True)
        radius, name = self._radius()
        wide = math.dist(scene.world.fence.low, scene.world.fence.high)
        needed = 2 * radius if 2 * radius <= wide else 0.0
        asked = scene.limits.separation if self._is_given("limits", "separation") else 0.0
        apart, what = max((needed, f"twice {name}"), (asked, "limits.separation"))
        for first, second in combinations(scene.agents, 2):
            distance = math.dist(first.start, second.start)
            if distance < apart:
                yield Problem(
                    ("swarm", second.name, "start"),
                    f"{second.name!r} starts {distance:.2f} m from {first.name!r}, "
                    f"closer than {what} ({apart:.2f} m)",
                    "too-close",
                )

    def reserve(self) -> Iterator[Problem]:
        """Yield unknown agents in reserve, impossible voltages, and climbs into obstacles."""
        reserve, names = self.data["reserve"], self.scene.names
        listed = reserve.get("agents", ())
        for i, name in enumerate(listed):
            if name not in names:
                yield unknown_name(("reserve", "agents", i), "agent", name, names, "unknown-agent")
        if {*names} <= {*listed}:
            message = "every agent is in reserve; leave one to be relieved"
            yield Problem(("reserve", "agents"), message, "agent-not-in-mission")
        if isinstance(reserve, Incomplete) or not reserve:
            return
        if fault := self.scene.height_fault(reserve["height"]):
            yield Problem(("reserve", "height"), fault, "out-of-range")
        tired, ready = reserve["relieve_below"], reserve["ready_above"]
        if tired >= ready:
            key = "ready_above" if self._is_given("reserve", "ready_above") else "relieve_below"
            yield Problem(
                ("reserve", key),
                f"a reserve that takes off at ready_above, {ready:g} V, would be relieved at once: "
                f"relieve_below is {tired:g} V",
                "option-conflict",
            )
        for i, name in enumerate(listed):
            if name in names:
                path = ("reserve", "agents", i)
                yield from self._climb(path, names.index(name), reserve["height"])

    def safety(self, steps: Iterable[Action]) -> Iterator[Problem]:
        """Yield where ``safety.fence_near`` would trigger at once.

        Args:
            steps: Of the mission.
        """
        rule = self.data["safety"].get("fence_near")
        if rule is None or isinstance(rule, Incomplete):
            return
        near, fence = rule["within"], self.scene.world.fence
        path = ("safety", "fence_near", "within")
        narrow = min(high - low for low, high in zip(fence.low, fence.high, strict=True))
        if 2 * near >= narrow:
            what = f"every position inside the fence is within {near:g} m of it"
            yield Problem(path, f"{what}: it is {narrow:g} m wide", "fence-too-near")
            return
        then = f"safety.fence_near would {rule['then']} every agent that flies within {near:g} m"
        for agent in self.scene.agents:
            room = min(_room(fence, agent.start, 0), _room(fence, agent.start, 1))
            if 0 <= room <= near:
                yield Problem(
                    ("swarm", agent.name, "start"),
                    f"{agent.name!r} starts {room:.2f} m from a side of the fence, and {then}",
                    "fence-too-near",
                )
        (low, high), (floor, ceiling) = self.scene.limits.height, (fence.low[2], fence.high[2])
        if low < high and max(low, floor + near) >= min(high, ceiling - near):
            yield Problem(
                path,
                f"every height to fly at, from {low:g} to {high:g} m, is within {near:g} m of the "
                f"floor or the ceiling of the fence, at {floor:g} and {ceiling:g} m",
                "fence-too-near",
            )
            return
        climbs = [((*step.at, "height"), height) for step, height in self._climbing(steps)]
        if self.data["reserve"] and not isinstance(self.data["reserve"], Incomplete):
            climbs.append((("reserve", "height"), self.data["reserve"]["height"]))
        for at, height in climbs:
            room = _room(fence, (0.0, 0.0, height), 2)
            if 0 <= room <= near and self.scene.height_fault(height) is None:
                side = "floor" if height - floor <= ceiling - height else "ceiling"
                message = f"{height:g} m is {room:.2f} m from the {side} of the fence, and {then}"
                yield Problem(at, message, "fence-too-near")

    def climbs(self, steps: Iterable[Action], reserve: Sequence[int]) -> Iterator[Problem]:
        """Yield the obstacles that agents would climb into.

        Only the first climb of each agent is checked, from its start: where it takes off again is
        not known before the flight.

        Args:
            steps: Of the mission, in order.
            reserve: Rows of agents that only a `join` brings into the mission.
        """
        standing = set(range(len(self.scene.agents)))
        for step in steps:
            if not step.known:  # where its agents are afterwards is not known
                return
            spec = self.registry.find("task", step.verb).offer
            climbing = [
                row for row in step.rows
                if row in standing and (row not in reserve or step.verb == JOIN)
            ]  # fmt: skip
            for _, height in self._climbing([step]):
                for row in climbing:
                    yield from self._climb(step.path, row, height)
            if spec.after not in {"same", "ground"}:
                standing.difference_update(climbing)

    def _climbing(self, steps: Iterable[Action]) -> Iterator[tuple[Action, float]]:
        """Yield the steps that take agents from the ground to a height, and that height, m."""
        for step in steps:
            spec = self.registry.find("task", step.verb).offer
            height = step.options.get("height")
            if (spec.before, spec.after) == ("ground", "air") and isinstance(height, int | float):
                yield step, height

    def _climb(self, path: Sequence[str | int], row: int, height: float) -> Iterator[Problem]:
        """Yield the obstacle that an agent hits when it climbs from its start to a height."""
        agent, world = self.scene.agents[row], self.scene.world
        if math.isnan(agent.start[0]):  # not known
            return
        hit = world.overhead(agent.start, height)
        if hit is not None and not world.contact_fault(agent.start):
            foot, top = hit.height
            yield Problem(
                tuple(path),
                f"{agent.name!r} cannot climb to {height:g} m: obstacle {hit.name!r} is over its "
                f"start, from {foot:g} to {top:g} m",
                "inside-obstacle",
            )

    def _in_air(self, start: Point) -> bool:
        """Return whether there is neither the floor nor an obstacle below a start."""
        floor = max(0.0, self.scene.world.fence.low[2])
        return start[2] - floor > MAX_STAND and not any(
            obstacle.touched((start[0], start[1], start[2] - MAX_STAND), start[2])
            for obstacle in self.scene.world.obstacles
        )

    def _radius(self) -> tuple[float, str]:
        """Return the radius that is kept free around an agent, m, and its name."""
        options = self.data["avoider"]
        if isinstance(options, Incomplete) and "radius" not in options:
            return 0.0, ""
        radius = options.get("radius")
        contact = (CONTACT_RADIUS, "a drone's radius")
        return contact if radius is None else (radius, "avoider.radius")

    def _is_given(self, *path: str) -> bool:
        return self.document.get(path) is not None


def position_code(scene: Scene, position: Point) -> str:
    """Return the code of a position where no agent can be."""
    outside = scene.world.fence.distance(position) > 0
    return "outside-geofence" if outside else "inside-obstacle"


def _room(fence: Fence, point: Point, axis: int) -> float:
    """Return the distance of a point to the nearer side of a fence, m; negative beyond it."""
    return min(point[axis] - fence.low[axis], fence.high[axis] - point[axis])
