"""The tables that observers receive."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from star_core.world.scene import Scene

if TYPE_CHECKING:
    from star_core.messages.arrays import Mask
    from star_core.messages.state import Estimate, Goals, Health, Plan, Setpoint, Truth
    from star_core.messages.telemetry import Detections, Telemetry


@dataclass(frozen=True, slots=True)
class Flight:
    """The description of a flight, before anything moves.

    Attributes:
        mission: The mission's name.
        scene: That every plugin was made with.
        manifest: Needed to repeat the flight: mission and world as flown, plugins with their
            distributions and versions, seed, packages, platform.
        folder: For records; None if nothing is recorded.
        save_frames: Whether to record the cameras' images too.
    """

    mission: str
    scene: Scene
    manifest: Mapping[str, Any]
    folder: Path | None
    save_frames: bool = False


@dataclass(frozen=True, slots=True)
class Corrected:
    """Agents whose setpoints the safety filter changed, by the reason: (N,) each.

    Attributes:
        fence: The agent would have left the fence.
        speed: It was faster than the limit.
        separation: It approached another agent faster than the two can brake.
        obstacle: It came nearer to an obstacle or the fence than its uncertain position permits.
    """

    fence: Mask
    speed: Mask
    separation: Mask
    obstacle: Mask


@dataclass(frozen=True, slots=True)
class Tick:
    """Inputs and outputs of all stages of one tick.

    Attributes:
        time: Mission time, s.
        telemetry: From the transport.
        estimate: From the localizer.
        health: Phase, battery and link of each agent.
        goals: From the tasks.
        plan: From the planner.
        sent: The setpoint after avoider, safety filter and the transport's limits, in the map.
        truth: Ground truth, if the transport has it. For records only.
        doing: The running steps, in words.
        corrected: Agents whose setpoints the safety filter changed.
        timing: Times of this tick, s: ``late``, after it was due; ``tick``, spent since it began,
            without observers; ``localizer``, ``planner``, ``avoider`` and ``safety`` (the safety
            filter), which are contained in that.
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
    timing: Mapping[str, float] = field(default_factory=dict)

    @property
    def detections(self) -> Detections:
        """All tags detected in images: on board, and by the localizer."""
        reported = self.telemetry.detections
        return reported.merged((reported, self.estimate.detections))


@dataclass(frozen=True, slots=True)
class Event:
    """An event of the record.

    Attributes:
        time: Mission time, s.
        kind: One word: ``step``, ``failure``, ``collision``, ``safety``, ``interrupt`` …
        text: Description.
        agent: The agent that it happened to, if it is one.
        details: Description for programs, as JSON; the keys depend on the kind.
    """

    time: float
    kind: str
    text: str
    agent: str | None = None
    details: Mapping[str, Any] | None = None

    def is_about(self, names: Collection[str]) -> bool:
        """Return whether it happened to one of some agents."""
        agents = (self.details or {}).get("agents", ())
        return self.agent in names or any(name in names for name in agents)

    def __str__(self) -> str:
        """Return the line of the log."""
        return f"{self.time:8.2f} s  {self.text}"
