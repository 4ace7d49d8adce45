"""The safety rules of a mission, which remove agents from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from star_core.messages.arrays import Array, Mask, every, some
from star_core.messages.state import AgentPhase, Estimate, Health, among
from star_core.safety.agents_in_the_way import MAX_REPORT_AGE
from star_core.safety.monitors import Exclude, SafetyAction, Stage, TickState
from star_core.world.scene import Scene

BATTERY_SAG_TIME: Final = 1.0  # s that a battery must stay below its limit: it sags under load
SUNK_TIME: Final = 2.0  # s that a flying agent must stay at the floor: some rebound
FLOOR_SHARE: Final = 0.5  # of the lowest height to fly at: below it is the floor


class Rules:
    """Applies the rules to every agent. An action is never undone; a more severe one replaces it.

    Args:
        rules: The mission's ``safety`` with defaults: by rule its numbers and its action.

    Attributes:
        action: (N,) `SafetyAction` for each agent so far.
    """

    after = Stage.TRACKED

    def __init__(self, scene: Scene, rules: Mapping[str, Mapping[str, Any]]) -> None:
        n = len(scene.agents)
        self._scene = scene
        self._started = False
        self._low = np.array(scene.world.fence.low)
        self._high = np.array(scene.world.fence.high)
        self._floor = FLOOR_SHARE * scene.limits.height[0]
        self._rules = rules
        self._since = {name: np.full(n, np.nan) for name in self._rules}  # s, of each violation
        self.action = np.zeros(n, np.int64)

    def check(self, state: TickState) -> Sequence[Exclude]:
        """Return the agents that violate a rule; `record` keeps those that do from now on."""
        return self.violators(state.telemetry.time, state.estimate, state.health)

    def violators(self, time: float, estimate: Estimate, health: Health) -> list[Exclude]:
        """Return the agents that violate a rule at a mission time, s."""
        excluded: list[Exclude] = []
        for name, rule in self._rules.items():
            violated, duration, reason = self._violations(name, rule, estimate, health)
            since = np.where(violated, np.fmin(self._since[name], time), np.nan)
            self._since[name] = since
            fires = violated & (time - since >= duration)
            action = SafetyAction[rule["then"].upper()]
            excluded += [
                Exclude(row, action, f"{name}: {reason(row)}")
                for row in np.flatnonzero(fires).tolist()
            ]
        return excluded

    def record(self, finding: Exclude) -> bool:
        """Note the action of a finding; return whether it replaces a milder one."""
        milder = bool(self.action[finding.row] < finding.action)
        if milder:
            self.action[finding.row] = finding.action
        return milder

    def reset(self, row: int) -> None:
        """Cancel the action for an agent that is fit again."""
        self.action[row] = SafetyAction.NOTHING

    def reason_to_end(self, health: Health, unassigned: Mask) -> str:
        """Return why the mission does not begin, or has no agent left; empty if it goes on.

        Args:
            health: Of the agents.
            unassigned: (N,) agents that are not in the mission.
        """
        if not self._started:
            self._started = True
            limit = self._rules.get("battery_low", {"below": -np.inf})["below"]  # V
            low = (health.battery < limit) & ~unassigned
            if some(low):
                names, volts = self._scene.named(np.flatnonzero(low)), health.battery[low].min()
                return f"not started: battery_low: {names} at {volts:.2f} V, below {limit:g} V"
        none_left = np.count_nonzero(self.action) and every(unassigned)
        return "the safety rules left no agent" if none_left else ""

    def excuse(self, health: Health, located: Mask) -> Mask:
        """(N,) agents that are lost, but that a rule will act on: their steps do not fail yet."""
        excused = np.zeros(len(health.age), np.bool_)
        if not some(among(health.phase, AgentPhase.LOST, AgentPhase.LANDING)):
            return excused
        heard = health.age <= MAX_REPORT_AGE
        lost = health.phase == AgentPhase.LOST
        if "link_lost" in self._rules:
            excused |= (lost | (health.phase == AgentPhase.LANDING)) & ~heard
        if "position_lost" in self._rules:
            excused |= lost & heard & ~located
        return excused

    def _violations(
        self, name: str, rule: Mapping[str, Any], estimate: Estimate, health: Health
    ) -> tuple[Mask, float | Array, Callable[[int], str]]:
        """Return which agents violate a rule, how long they must to trigger it, s, and why.

        The last is a function of the row.
        """
        phase = health.phase
        flies = (phase == AgentPhase.FLYING) | (phase == AgentPhase.LOST)
        match name:
            case "battery_low":
                low = health.battery < rule["below"]
                return low, BATTERY_SAG_TIME, lambda row: f"battery at {health.battery[row]:.2f} V"
            case "link_lost":
                unheard = health.age >= rule["after"]
                return unheard, 0.0, lambda row: f"not heard for {health.age[row]:.1f} s"
            case "position_lost":
                unlocated = flies & (health.age <= MAX_REPORT_AGE) & ~estimate.valid
                return unlocated, rule["after"], lambda _: f"not located for {rule['after']:g} s"
            case "fence_near":
                position = estimate.position
                room = np.minimum(self._high - position, position - self._low).min(axis=1)
                near = flies & estimate.valid & (room <= rule["within"])
                return near, 0.0, lambda row: f"{max(0.0, room[row]):.2f} m from the fence"
        fallen = phase == AgentPhase.EMERGENCY
        low = (phase == AgentPhase.FLYING) & (estimate.position[:, 2] < self._floor)
        sunk = ~fallen & low & estimate.valid & (health.age <= MAX_REPORT_AGE)
        tumbled, lies = "tumbled, crashed, locked or rebooted", "sank to the floor"
        duration = np.where(sunk, SUNK_TIME, 0.0)
        return fallen | sunk, duration, lambda row: lies if sunk[row] else tumbled
