"""What observers are told about a flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from star_core.scene import Scene

if TYPE_CHECKING:
    from star_core.messages.arrays import Mask
    from star_core.messages.state import Estimate, Goals, Health, Plan, Setpoint, Truth
    from star_core.messages.telemetry import Telemetry


@dataclass(frozen=True, slots=True)
class Flight:
    """What is known before anything moves.

    Attributes:
        mission: The mission's name.
        scene: What every plugin was made with.
        manifest: What to keep to fly it again: the mission and world as flown, plugins with their
            distributions and versions, seed, packages, platform.
        folder: Where records go; None keeps none.
        save_frames: Whether to keep the cameras' images too.
    """

    mission: str
    scene: Scene
    manifest: Mapping[str, Any]
    folder: Path | None
    save_frames: bool = False


@dataclass(frozen=True, slots=True)
class Corrected:
    """Whose setpoint the core changed, by the reason: (N,) each.

    Attributes:
        fence: Would have left the fence.
        speed: Was faster than the limit.
        separation: Closed in on another agent faster than the two can brake.
    """

    fence: Mask
    speed: Mask
    separation: Mask


@dataclass(frozen=True, slots=True)
class Tick:
    """Everything one tick was made of.

    Attributes:
        time: Mission time, s.
        telemetry: What was received.
        estimate: Where the agents are believed to be.
        health: Phase, battery and link of each agent.
        goals: What the tasks want.
        plan: What the planner answered.
        sent: What was sent after avoider and limits, in the map.
        truth: Where the agents really are, if the transport can know. For records only.
        doing: The steps under way, in words.
        corrected: Whose setpoint the core changed.
    """

    time: float
    telemetry: Telemetry
    estimate: Estimate
    health: Health
    goals: Goals
    plan: Plan
    sent: Setpoint
    truth: Truth | None
    doing: str
    corrected: Corrected


@dataclass(frozen=True, slots=True)
class Event:
    """Something that belongs in the record.

    Attributes:
        time: Mission time, s.
        kind: One word: ``step``, ``failure``, ``collision``, ``safety``, ``interrupt`` …
        text: What happened.
        agent: The agent that it happened to, if one.
        details: What happened, for programs, as JSON; the keys depend on the kind.
    """

    time: float
    kind: str
    text: str
    agent: str | None = None
    details: Mapping[str, Any] | None = None
