"""Safety rules of a mission: which agents violate one, and the action that follows."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.state import AgentPhase, Estimate, Health
from star_core.scene import Scene

BATTERY_SAG_TIME: Final = 1.0
"""How long a battery must stay below its limit, s: it sags under load."""

DEFAULTS: Final[Mapping[str, Mapping[str, float]]] = {
    "battery_low": {"below": 3.5},
    "link_lost": {"after": 0.5},
    "position_lost": {"after": 1.0},
    "fence_near": {"within": 0.0},
    "tumbled": {},
}
"""What the mission schema says of each rule that a mission names without its numbers."""


class SafetyAction(IntEnum):
    """What a rule does with an agent, from the mildest to the most severe."""

    NOTHING = 0
    HOLD = 1
    LAND = 2
    STOP = 3


class Verdict(NamedTuple):
    """The action for an agent from now on, and the reason."""

    row: int
    answer: SafetyAction
    reason: str


class Rules:
    """Applies the rules to every agent. An action is never undone; a more severe one replaces it.

    Args:
        scene: Agents and fence.
        rules: The mission's ``safety``: by rule its numbers and its answer, ``then``.

    Attributes:
        answer: (N,) `SafetyAction` for each agent so far.
    """

    def __init__(self, scene: Scene, rules: Mapping[str, Mapping[str, Any]]) -> None:
        n = len(scene.agents)
        self._low = np.array(scene.world.fence.low)
        self._high = np.array(scene.world.fence.high)
        self._rules = {name: {**DEFAULTS[name], **given} for name, given in rules.items()}
        self._since = {name: np.full(n, np.nan) for name in self._rules}  # s, since when it is so
        self.answer = np.zeros(n, np.int64)

    def judge(self, time: float, estimate: Estimate, health: Health) -> list[Verdict]:
        """Return what is new at a mission time, s."""
        new = []
        for name, rule in self._rules.items():
            wrong, lasts, why = self._wrong(name, rule, estimate, health)
            since = self._since[name] = np.where(wrong, np.fmin(self._since[name], time), np.nan)
            fires = wrong & (time - since >= lasts)
            answer = SafetyAction[rule.get("then", "land").upper()]
            for row in np.flatnonzero(fires & (self.answer < answer)).tolist():
                self.answer[row] = answer
                new.append(Verdict(row, answer, f"{name}: {why[row]}"))
        return new

    def reset(self, row: int) -> None:
        """Forget what was decided of an agent that is fit again."""
        self.answer[row] = 0

    def excuse(self, health: Health, located: Mask) -> Mask:
        """(N,) agents that are lost, but that a rule will act on: their steps do not fail yet."""
        heard = health.age <= DEFAULTS["link_lost"]["after"]
        excused = np.zeros(len(heard), np.bool_)
        lost = health.phase == AgentPhase.LOST
        if "link_lost" in self._rules:
            excused |= lost & ~heard
        if "position_lost" in self._rules:
            excused |= lost & heard & ~located
        return excused

    def _wrong(
        self, name: str, rule: Mapping[str, Any], estimate: Estimate, health: Health
    ) -> tuple[Mask, float, list[str]]:
        """Return which agents violate a rule now, how long they must, s, and the reasons."""
        phase = health.phase
        flies = (phase == AgentPhase.FLYING) | (phase == AgentPhase.LOST)
        heard = health.age <= DEFAULTS["link_lost"]["after"]
        match name:
            case "battery_low":
                told = [f"battery at {volt:.2f} V" for volt in health.battery]
                return health.battery < rule["below"], BATTERY_SAG_TIME, told
            case "link_lost":
                told = [f"not heard for {age:.1f} s" for age in health.age]
                return health.age >= rule["after"], 0.0, told
            case "position_lost":
                told = [f"not located for {rule['after']:g} s"] * len(phase)
                return flies & heard & ~estimate.valid, rule["after"], told
            case "fence_near":
                room = self._room(estimate.position)
                told = [f"{max(0.0, left):.2f} m from the fence" for left in room]
                return flies & estimate.valid & (room <= rule["within"]), 0.0, told
        return (
            phase == AgentPhase.EMERGENCY,
            0.0,
            ["tumbled, crashed, locked or rebooted"] * len(phase),
        )

    def _room(self, position: Array) -> Array:
        """(N,) distance to the nearest side of the fence, m; negative beyond it."""
        room: Array = np.minimum(self._high - position, position - self._low).min(axis=1)
        return room
