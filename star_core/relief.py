"""Reserves: agents that take over from those whose batteries run low, in flight."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from star_core.options import RESERVE
from star_core.orders import Command, Order
from star_core.roster import Roster
from star_core.rules import SAGS, Rules
from star_core.scene import Scene
from star_core.swarm import AgentPhase, Estimate, Health, among
from star_core.table import Array, Mask
from star_core.wishes import Wishes

CLEAR: Final = 0.5
"""How far others in the air must be from the pad of an agent that takes off, in the plane, m."""

HOME: Final = 0.15
"""How near to its pad an agent that flies home must be before it lands, in the plane, m."""

SETTLED: Final = 0.15
"""What an agent that is to land is slower than, m/s."""

HEARD: Final = 0.5
"""How long ago an agent that takes off may have been heard, s."""

PATIENCE: Final = 3.0
"""How many times what a climb or a straight flight home takes it may take, and `GRACE` besides."""

GRACE: Final = 5.0
"""Of a climb or a flight home, s."""

CLIMB: Final = 0.3
"""Mean speed of a climb, m/s, as of the verb ``takeoff``."""

DOWN: Final = (AgentPhase.GROUNDED, AgentPhase.LANDED)
DONE: Final = (*DOWN, AgentPhase.LANDING)


class Relief:
    """Sends reserves up and brings home whom they relieve.

    An agent on the ground is ready if it is heard and located, its battery is above a voltage, and
    nobody flies near its pad; once relieved and given another battery, it is a reserve again. A
    reserve fills a place that the safety rules have emptied, or relieves the agent in flight whose
    battery is lowest, once that stays below a voltage. It takes the place over when it has climbed;
    only then does the other fly to its own pad, and land. Where that has landed meanwhile, or is
    about to, the reserve goes home instead.

    Args:
        scene: Agents, pads (where agents start) and limits.
        roster: Who is in the mission.
        rules: What became of whom; forgotten for an agent that is ready again.
        reserve: The mission's ``reserve``; empty if it has none.
        tell: Told what is done: text, and the agent.
    """

    def __init__(
        self,
        scene: Scene,
        roster: Roster,
        rules: Rules,
        reserve: Mapping[str, Any],
        tell: Callable[[str, str], None],
    ) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._roster = roster
        self._rules = rules
        self._exists = bool(reserve)
        self._options = {**RESERVE, **reserve}
        self._tell = tell
        self._pad = np.array([agent.start for agent in scene.agents])
        self._low_since = np.full(n, np.nan)  # s
        self._coming: dict[int, int] = {}  # which place each agent that climbs is to take
        self._climbed_by: dict[int, float] = {}  # s, when it should have climbed at the latest
        self._unfit: set[int] = set()  # who was to climb and did not
        self._home: dict[int, float | None] = {}  # who flies to its pad, and until when at most, s

    def step(self, time: float, estimate: Estimate, health: Health, wishes: Wishes) -> None:
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
        long = time - self._low_since >= SAGS
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
                self._rules.answer[row] = 0
                return int(row)
        return None

    def _clear(self, position: Array, down: Mask, row: int) -> bool:
        """Whether nobody flies near an agent on the ground."""
        others = ~down
        others[row] = False
        away = np.hypot(*(position[others, :2] - position[row, :2]).T)
        return bool((away > CLEAR).all())

    def _send_up(
        self, row: int, place: int, time: float, estimate: Estimate, wishes: Wishes
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
        self._climbed_by[row] = time + PATIENCE * float(duration[0]) + GRACE
        self._home.pop(row, None)
        whom = self._roster.holders([place])
        what = f"to relieve {self._scene.named(whom.values())}" if whom else "to fill a place"
        self._tell(f"{name} takes off {what}", name)

    def _take_over(self, time: float, health: Health, wishes: Wishes) -> None:
        """Let those that have climbed take their places, and forget those that cannot."""
        for row, place in list(self._coming.items()):
            if health.phase[row] == AgentPhase.FLYING:
                del self._coming[row]
                relieved = self._roster.holders([place]).get(place)
                name = self._scene.agents[row].name
                if relieved is not None and health.phase[relieved] in DONE:
                    self._tell(f"{name} is not needed any more", name)
                    self._home[row] = None
                    continue
                self._roster.take(place, row)
                self._tell(f"{name} takes over", name)
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
                self._tell(f"{name} does not climb and is no reserve any more", name)

    def _fly_home(self, time: float, estimate: Estimate, health: Health, wishes: Wishes) -> None:
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
                self._home[row] = time + PATIENCE * way / speed + GRACE
            wishes.send(row, over, estimate.yaw[row], speed)
            slow = np.linalg.norm(estimate.velocity[row]) < SETTLED
            if late:
                name = self._scene.agents[row].name
                self._tell(f"{name} does not get home and lands where it is", name)
            if (way < HOME and slow) or late:
                del self._home[row]
                wishes.leave.add(row)
