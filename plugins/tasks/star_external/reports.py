"""Messages to the other process, one JSON object per line."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, Final

from star_core import AgentPhase, Estimate, Health, Scene

VERSION: Final = 1
"""Version of the protocol."""


def greeting(scene: Scene, rows: Sequence[int], rate: float, *, lockstep: bool) -> bytes:
    """Return the greeting: the agents to control, limits and fence.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        rate: State lines per second, 1/s.
        lockstep: Whether the simulation waits for an answer to each state line.
    """
    limits, fence = scene.limits, scene.world.fence
    return _line(
        {
            "star": VERSION,
            "agents": [scene.agents[row].name for row in rows],
            "rate": rate,
            "lockstep": lockstep,
            "limits": {
                "speed": limits.speed,
                "acceleration": limits.acceleration,
                "height": list(limits.height),
                "separation": limits.separation,
            },
            "fence": {"low": list(fence.low), "high": list(fence.high)},
        }
    )


def state(scene: Scene, rows: Sequence[int], estimate: Estimate, health: Health) -> bytes:
    """Return the state line of the agents; unknown values are null.

    Args:
        scene: The mission's scene.
        rows: Rows of the agents.
        estimate: Of this tick.
        health: Of this tick.
    """
    agents = {}
    for row in rows:
        known, battery = bool(estimate.valid[row]), float(health.battery[row])
        agents[scene.agents[row].name] = {
            "position": estimate.position[row].tolist() if known else None,
            "velocity": _finite(estimate.velocity[row].tolist()) if known else None,
            "yaw": float(estimate.yaw[row]) if known else None,
            "phase": AgentPhase(health.phase[row]).name.lower(),
            "battery": battery if math.isfinite(battery) else None,
        }
    return _line({"time": estimate.time, "agents": agents})


def refusal(why: str, number: int) -> bytes:
    """Return the error line for an invalid line: the reason and its number, from 1."""
    return _line({"error": why, "line": number})


def _finite(values: list[float]) -> list[float] | None:
    return values if all(math.isfinite(value) for value in values) else None


def _line(value: Any) -> bytes:
    return json.dumps(value, allow_nan=False).encode() + b"\n"
