"""Safety rules of a mission: which agents are in trouble, and what becomes of them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np

from star_core.scene import Scene
from star_core.swarm import AgentPhase, Estimate, Health
from star_core.table import Array, Mask

SAGS: Final = 1.0
"""How long a battery must stay below its limit, s: it sags while motors pull hard."""

DEFAULTS: Final[Mapping[str, Mapping[str, float]]] = {
    "battery_low": {"below": 3.5},
    "link_lost": {"after": 0.5},
    "position_lost": {"after": 1.0},
    "fence_near": {"within": 0.0},
    "tumbled": {},
}
"""What the mission schema says of each rule that a mission names without its numbers."""


class Answer(IntEnum):
    """What becomes of an agent, from the mildest to the gravest."""

    NOTHING = 0
    HOLD = 1
    LAND = 2
    STOP = 3


class Verdict(NamedTuple):
    """What is to become of an agent from now on, and why."""

    row: int
    answer: Answer
    reason: str


class Rules:
    """Watches over every agent. A rule that fired is not taken back, but a graver one goes over it.

    Args:
        scene: Agents and fence.
        rules: The mission's ``safety``: by rule its numbers and its answer, ``then``.

    Attributes:
        answer: (N,) `Answer` for each agent so far.
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
            answer = Answer[rule.get("then", "land").upper()]
            for row in np.flatnonzero(fires & (self.answer < answer)).tolist():
                self.answer[row] = answer
                new.append(Verdict(row, answer, f"{name}: {why[row]}"))
        return new

    def excuse(self, health: Health, located: Mask) -> Mask:
        """(N,) who cannot go on with its step, but the rules will say what becomes of it."""
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
        """Who is in one kind of trouble now, how long that must last, s, and how to tell it."""
        phase = health.phase
        flies = (phase == AgentPhase.FLYING) | (phase == AgentPhase.LOST)
        heard = health.age <= DEFAULTS["link_lost"]["after"]
        match name:
            case "battery_low":
                told = [f"battery at {volt:.2f} V" for volt in health.battery]
                return health.battery < rule["below"], SAGS, told
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
        return phase == AgentPhase.EMERGENCY, 0.0, ["tumbled, crashed or locked"] * len(phase)

    def _room(self, position: Array) -> Array:
        """(N,) distance to the nearest side of the fence, m; negative beyond it."""
        room: Array = np.minimum(self._high - position, position - self._low).min(axis=1)
        return room
