"""Reserves: agents that replace those whose batteries run low, in flight."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from star_core.errors import shortlist
from star_core.execution.assignments import Assignments
from star_core.execution.instructions import Instructions
from star_core.execution.step_run import TickContext
from star_core.messages.arrays import Array, Mask
from star_core.messages.commands import Command, Order
from star_core.messages.state import UNFIT, AgentPhase, Estimate, Health, among
from star_core.safety.agents_in_the_way import MAX_REPORT_AGE
from star_core.safety.rules import BATTERY_SAG_TIME, Rules
from star_core.toolkit.timeouts import timeout
from star_core.world.scene import Scene

PAD_CLEARANCE: Final = 0.5  # m in the plane from an agent that takes off to others in the air
PAD_RADIUS: Final = 0.15  # m in the plane from its pad, within which a returning agent lands
MAX_REST_SPEED: Final = 0.15  # m/s; an agent slower than that can land
REPORT_WAIT_AFTER: Final = 2.0  # s without a reserve that is ready
CLIMB_SPEED: Final = 0.3  # m/s, as of the verb `takeoff`
ON_GROUND: Final = (AgentPhase.GROUNDED, AgentPhase.LANDED)


class ReserveManager:
    """Launches reserve agents and returns the agents that they replace.

    An agent on the ground is ready if it is heard and located, its battery is above a voltage, and
    no agent flies near its pad; once replaced and given another battery, it is a reserve again. A
    reserve fills a slot that the safety rules have emptied, or relieves the agent in flight whose
    battery is lowest, once that stays below a voltage, but none that has been commanded to land. It
    is assigned to the slot when it has climbed; only then does the other agent fly to its own pad,
    and land. If that has landed meanwhile, or is landing, the reserve returns instead.

    Args:
        rules: Their actions so far; reset for an agent that is ready again.
        reserve: The mission's ``reserve`` with its defaults.
        report: Reports what is done: text, and the agent if it concerns one.
    """

    def __init__(
        self,
        scene: Scene,
        assignments: Assignments,
        rules: Rules,
        reserve: Mapping[str, Any],
        report: Callable[[str, str | None], None],
    ) -> None:
        self._scene = scene
        self._assignments = assignments
        self._rules = rules
        self._options = reserve
        self._report = report
        self._pad = np.array([agent.start for agent in scene.agents])
        self._low_since = np.full(len(scene.agents), np.nan)  # s
        self._to_land = np.zeros(len(scene.agents), np.bool_)  # in flight, commanded to land
        self._report_at: float | None = None  # s, if it waits for a reserve
        self._climbing: dict[int, tuple[int, float]] = {}  # slot and latest end, s, by row
        self._unfit: set[int] = set()  # agents that did not climb when launched
        self._returning: dict[int, float | None] = {}  # latest arrival at their pads, s, by row

    def step(self, tick: TickContext, instructions: Instructions) -> None:
        """Add the instructions of agents that are launched or return."""
        time, health = tick.time, tick.health
        flies = health.phase == AgentPhase.FLYING
        for command in instructions.commands:
            if command.order is Order.LAND:
                self._to_land[command.agent] = True
        self._to_land &= flies
        low = flies & ~self._to_land & (health.battery < self._options["relieve_below"])
        self._low_since = np.where(low, np.fmin(self._low_since, time), np.nan)
        self._finish_climbs(time, health, instructions)
        self._return(tick, instructions)
        slots = self._slots_to_fill(time)
        if not slots:
            self._report_at = None
        for slot in slots:
            row = self._ready(tick.estimate, health)
            if row is None:
                self._report_wait(slot, time, health)
                return
            self._report_at = None
            self._launch(row, slot, tick, instructions)

    def _report_wait(self, slot: int, time: float, health: Health) -> None:
        """Report once, after a while, why no reserve is ready."""
        if self._report_at is None:
            self._report_at = time + REPORT_WAIT_AFTER
        if time < self._report_at:
            return
        self._report_at = np.inf
        on_ground = among(health.phase, *ON_GROUND) & self._assignments.unassigned
        limit = self._options["ready_above"]
        reasons = [
            f"{self._scene.agents[row].name} is at {health.battery[row]:.2f} V, {limit:g} V needed"
            if health.battery[row] <= limit
            else f"{self._scene.agents[row].name} cannot take off yet"
            for row in np.flatnonzero(on_ground).tolist()
        ]
        relieved = self._scene.named(self._assignments.holders([slot]).values())
        aim = f"relieve {relieved}" if relieved else "fill a slot"
        why = shortlist(reasons) or "none is on the ground"
        self._report(f"waiting for a reserve to {aim}: {why}", None)

    def _slots_to_fill(self, time: float) -> list[int]:
        """Return the slots that need a reserve and have none climbing, the most urgent first."""
        low = np.flatnonzero(time - self._low_since >= BATTERY_SAG_TIME).tolist()
        tired = [
            self._assignments.slot(row) for _, row in sorted((self._low_since[r], r) for r in low)
        ]
        slots = [*self._assignments.vacancies(), *(slot for slot in tired if slot is not None)]
        filled = {slot for slot, _ in self._climbing.values()}
        return [slot for slot in slots if slot not in filled]

    def _ready(self, estimate: Estimate, health: Health) -> int | None:
        """Return the agent on the ground with the fullest battery that may take off, if any."""
        on_ground = among(health.phase, *ON_GROUND)
        ready = on_ground & estimate.valid & self._assignments.unassigned
        ready &= (health.age <= MAX_REPORT_AGE) & (health.battery > self._options["ready_above"])
        ready[[*self._climbing, *self._unfit]] = False
        order = np.argsort(-health.battery[ready], kind="stable")
        for row in np.flatnonzero(ready)[order].tolist():
            if self._clear(estimate.position, on_ground, row):
                self._rules.reset(row)
                return int(row)
        return None

    @staticmethod
    def _clear(position: Array, on_ground: Mask, row: int) -> bool:
        """Return whether no agent flies near an agent on the ground."""
        others = ~on_ground
        others[row] = False
        away = np.hypot(*(position[others, :2] - position[row, :2]).T)
        return bool((away > PAD_CLEARANCE).all())

    def _launch(self, row: int, slot: int, tick: TickContext, instructions: Instructions) -> None:
        name = self._scene.agents[row].name
        top = tick.estimate.position[[row]].copy()
        climb = self._options["height"] - float(top[0, 2])
        top[0, 2] = self._options["height"]
        duration = np.array([max(1.0, climb / CLIMB_SPEED)])
        yaw = tick.estimate.yaw[[row]]
        instructions.commands.append(Command(Order.TAKEOFF, np.array([row]), top, yaw, duration))
        instructions.goals.set(row, top[0], yaw[0], self._scene.limits.speed)
        self._climbing[row] = slot, tick.time + timeout(float(duration[0]))
        self._returning.pop(row, None)
        replaced = self._assignments.holders([slot])
        aim = f"relieve {self._scene.named(replaced.values())}" if replaced else "fill a slot"
        self._report(f"{name} takes off to {aim}", name)

    def _finish_climbs(self, time: float, health: Health, instructions: Instructions) -> None:
        """Assign agents that have climbed to their slots, and give up those that cannot climb."""
        for row, (slot, until) in list(self._climbing.items()):
            name = self._scene.agents[row].name
            if health.phase[row] == AgentPhase.FLYING:
                relieved = self._assignments.holders([slot]).get(slot)
                if relieved is not None and (
                    self._to_land[relieved]
                    or health.phase[relieved] in {*ON_GROUND, AgentPhase.LANDING}
                ):
                    self._report(f"{name} is not needed any more", name)
                    self._returning[row] = None
                else:
                    self._assignments.assign(slot, row)
                    self._report(f"{name} takes over", name)
                    if relieved is not None:
                        self._returning[relieved] = None
            elif health.phase[row] in UNFIT or self._rules.action[row]:
                instructions.leave.add(row)
            elif time >= until:
                self._unfit.add(row)
                instructions.leave.add(row)
                self._report(f"{name} does not climb and is no reserve any more", name)
            else:
                continue
            del self._climbing[row]

    def _return(self, tick: TickContext, instructions: Instructions) -> None:
        """Lead relieved agents to their pads, and land them there."""
        estimate, speed = tick.estimate, self._scene.limits.speed
        for row, until in list(self._returning.items()):
            if tick.health.phase[row] != AgentPhase.FLYING or self._rules.action[row]:
                del self._returning[row]
                continue
            position = estimate.position[row]
            goal = np.array([*self._pad[row, :2], position[2]])
            way = float(np.hypot(*(position - goal)[:2]))
            late = until is not None and tick.time >= until
            if until is None:
                self._returning[row] = tick.time + timeout(way / speed)
            instructions.goals.set(row, goal, estimate.yaw[row], speed)
            settled = way < PAD_RADIUS and np.linalg.norm(estimate.velocity[row]) < MAX_REST_SPEED
            if late:
                name = self._scene.agents[row].name
                self._report(f"{name} does not reach its pad and lands at its position", name)
            if settled or late:
                del self._returning[row]
                instructions.leave.add(row)
