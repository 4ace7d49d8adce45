"""Reserves: agents that take over from those whose batteries run low, in flight."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from star_core.execution.assignments import Assignments
from star_core.execution.goal_buffer import GoalBuffer
from star_core.messages.arrays import Array, Mask
from star_core.messages.commands import Command, Order
from star_core.messages.state import AgentPhase, Estimate, Health, among
from star_core.plugin_schema import RESERVE
from star_core.safety.rules import BATTERY_SAG_TIME, Rules
from star_core.scene import Scene
from star_core.toolkit.timeouts import timeout

CLEAR: Final = 0.5
"""How far others in the air must be from the pad of an agent that takes off, in the plane, m."""

HOME: Final = 0.15
"""How near to its pad an agent that flies home must be before it lands, in the plane, m."""

SETTLED: Final = 0.15
"""What an agent that is to land is slower than, m/s."""

HEARD: Final = 0.5
"""How long ago an agent that takes off may have been heard, s."""

CLIMB: Final = 0.3
"""Mean speed of a climb, m/s, as of the verb ``takeoff``."""

DOWN: Final = (AgentPhase.GROUNDED, AgentPhase.LANDED)
DONE: Final = (*DOWN, AgentPhase.LANDING)


class ReserveManager:
    """Launches reserve agents and returns the agents that they replace.

    An agent on the ground is ready if it is heard and located, its battery is above a voltage, and
    no agent flies near its pad; once replaced and given another battery, it is a reserve again. A
    reserve fills a place that the safety rules have emptied, or relieves the agent in flight whose
    battery is lowest, once that stays below a voltage. It takes the place over when it has climbed;
    only then does the other fly to its own pad, and land. Where that has landed meanwhile, or is
    about to, the reserve goes home instead.

    Args:
        scene: Agents, pads (where agents start) and limits.
        roster: The agents of the mission.
        rules: Their actions so far; reset for an agent that is ready again.
        reserve: The mission's ``reserve``; empty if it has none.
        report: Reports what is done: text, and the agent.
    """

    def __init__(
        self,
        scene: Scene,
        roster: Assignments,
        rules: Rules,
        reserve: Mapping[str, Any],
        report: Callable[[str, str], None],
    ) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._roster = roster
        self._rules = rules
        self._exists = bool(reserve)
        self._options = {**RESERVE, **reserve}
        self._report = report
        self._pad = np.array([agent.start for agent in scene.agents])
        self._low_since = np.full(n, np.nan)  # s
        self._coming: dict[int, int] = {}  # which place each agent that climbs is to take
        self._climbed_by: dict[int, float] = {}  # s, when it should have climbed at the latest
        self._unfit: set[int] = set()  # agents that did not climb when launched
        self._home: dict[
            int, float | None
        ] = {}  # latest arrival of agents that fly to their pads, s

    def step(self, time: float, estimate: Estimate, health: Health, wishes: GoalBuffer) -> None:
        """Do what is to be done at a mission time, s; what it takes is added to `wishes`."""
        if not self._exists:
            return
        flying = health.phase == AgentPhase.FLYING
        low = flying & (health.battery < self._options["relieve_below"])
        self._low_since = np.where(low, np.fmin(self._low_since, time), np.nan)
        self._take_over(time, health, wishes)
        self._fly_home(time, estimate, health, wishes)
        for place in self._wanted(time):
            row = self._ready(estimate, health)
            if row is None:
                return
            self._send_up(row, place, time, estimate, wishes)

    def _wanted(self, time: float) -> list[int]:
        """Places that a reserve should take and none is on its way to, the most urgent first."""
        long = time - self._low_since >= BATTERY_SAG_TIME
        tired = [(self._low_since[row], row) for row in np.flatnonzero(long).tolist()]
        places = [self._roster.place(row) for _, row in sorted(tired)]
        wanted = [*self._roster.vacancies(), *(place for place in places if place is not None)]
        return [place for place in wanted if place not in self._coming.values()]

    def _ready(self, estimate: Estimate, health: Health) -> int | None:
        """The agent on the ground with the fullest battery that may take off, if there is one."""
        down = among(health.phase, *DOWN) & estimate.valid & self._roster.left()
        down &= (health.age <= HEARD) & (health.battery > self._options["ready_above"])
        down[[*self._coming, *self._unfit]] = False
        for row in np.flatnonzero(down)[np.argsort(-health.battery[down], kind="stable")].tolist():
            if self._clear(estimate.position, among(health.phase, *DOWN), row):
                self._rules.reset(row)
                return int(row)
        return None

    def _clear(self, position: Array, down: Mask, row: int) -> bool:
        """Whether no agent flies near an agent on the ground."""
        others = ~down
        others[row] = False
        away = np.hypot(*(position[others, :2] - position[row, :2]).T)
        return bool((away > CLEAR).all())

    def _send_up(
        self, row: int, place: int, time: float, estimate: Estimate, wishes: GoalBuffer
    ) -> None:
        name = self._scene.agents[row].name
        top = estimate.position[[row]].copy()
        climb = self._options["height"] - float(top[0, 2])
        top[0, 2] = self._options["height"]
        duration = np.array([max(1.0, climb / CLIMB)])
        yaw = estimate.yaw[[row]]
        wishes.commands.append(Command(Order.TAKEOFF, np.array([row]), top, yaw, duration))
        wishes.send(row, top[0], yaw[0], self._scene.limits.speed)
        self._coming[row] = place
        self._climbed_by[row] = time + timeout(float(duration[0]))
        self._home.pop(row, None)
        replaced = self._roster.holders([place])
        what = (
            f"to relieve {self._scene.named(replaced.values())}" if replaced else "to fill a place"
        )
        self._report(f"{name} takes off {what}", name)

    def _take_over(self, time: float, health: Health, wishes: GoalBuffer) -> None:
        """Let those that have climbed take their places, and forget those that cannot."""
        for row, place in list(self._coming.items()):
            if health.phase[row] == AgentPhase.FLYING:
                del self._coming[row]
                relieved = self._roster.holders([place]).get(place)
                name = self._scene.agents[row].name
                if relieved is not None and health.phase[relieved] in DONE:
                    self._report(f"{name} is not needed any more", name)
                    self._home[row] = None
                    continue
                self._roster.take(place, row)
                self._report(f"{name} takes over", name)
                if relieved is not None:
                    self._home[relieved] = None
            elif (
                health.phase[row] in {AgentPhase.LOST, AgentPhase.EMERGENCY}
                or (self._rules.answer[row])
            ):
                del self._coming[row]
                wishes.leave.add(row)
            elif time >= self._climbed_by[row]:
                del self._coming[row]
                self._unfit.add(row)
                wishes.leave.add(row)
                name = self._scene.agents[row].name
                self._report(f"{name} does not climb and is no reserve any more", name)

    def _fly_home(
        self, time: float, estimate: Estimate, health: Health, wishes: GoalBuffer
    ) -> None:
        """Lead those that were relieved to their pads, and land them there."""
        for row, until in list(self._home.items()):
            if health.phase[row] != AgentPhase.FLYING or self._rules.answer[row]:
                del self._home[row]
                continue
            here, speed = estimate.position[row], self._scene.limits.speed
            over = np.array([*self._pad[row, :2], here[2]])
            way = float(np.hypot(*(here - over)[:2]))
            late = until is not None and time >= until
            if until is None:
                self._home[row] = time + timeout(way / speed)
            wishes.send(row, over, estimate.yaw[row], speed)
            slow = np.linalg.norm(estimate.velocity[row]) < SETTLED
            if late:
                name = self._scene.agents[row].name
                self._report(f"{name} does not get home and lands where it is", name)
            if (way < HOME and slow) or late:
                del self._home[row]
                wishes.leave.add(row)
