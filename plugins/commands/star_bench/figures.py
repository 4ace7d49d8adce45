"""Figures of one flight, from its row in the results of a study."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from star_bench.scenario import Scenario

PARTS: Final = ("localizer", "planner", "avoider", "safety")


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of one flight; None if unknown.

    Attributes:
        success: Whether all agents arrived and landed, without collisions.
        agent_agent: Collisions between agents.
        agent_obstacle: Collisions with obstacles.
        deadlocks: Number of times an agent made no progress for 5 s, nor did any it waited for.
        waits: Number of times an agent with a goal made no progress for 5 s, including deadlocks.
        separation: Least distance of two agents, m.
        clearance: Least distance from an obstacle, m.
        time_ratio: Arrival time of the last agent divided by its straight flight at the speed
            limit.
        path_ratio: Distance flown by all agents divided by their straight distances.
        corrected: Ticks of an agent in which the safety filter changed its setpoint.
        compute: Time of each of `PARTS` per agent and tick, µs.
    """

    success: bool
    agent_agent: float | None
    agent_obstacle: float | None
    deadlocks: float | None
    waits: float | None
    separation: float | None
    clearance: float | None
    time_ratio: float | None
    path_ratio: float | None
    corrected: float | None
    compute: Mapping[str, float | None]


def figures(row: Mapping[str, str], scenario: Scenario, speed: float) -> Figures:
    """Return the figures of a row of ``results.csv``.

    Args:
        row: Texts by column.
        scenario: The scenario flown.
        speed: The mission's speed limit, m/s.
    """
    agent_agent = _json(row.get("collisions.agent_agent"))
    agent_obstacle = _json(row.get("collisions.agent_obstacle"))
    compute = _json(row.get("compute_us"), {})
    corrected = _json(row.get("corrected"), {})
    lengths = _json(row.get("path_length_m.per_agent"), {})
    return Figures(
        success=row["outcome"] == "completed" and agent_agent == 0 and agent_obstacle == 0,
        agent_agent=agent_agent,
        agent_obstacle=agent_obstacle,
        deadlocks=_json(row.get("deadlocks")),
        waits=_json(row.get("waits")),
        separation=_json(row.get("min_separation_m")),
        clearance=_json(row.get("min_clearance_m")),
        time_ratio=time_ratio(_json(row.get("steps"), []), scenario, speed),
        path_ratio=path_ratio(lengths, scenario) if row["outcome"] == "completed" else None,
        corrected=sum(corrected.values()) if corrected else None,
        compute={part: compute.get(part) for part in PARTS},
    )


def time_ratio(
    steps: Sequence[Mapping[str, Any]], scenario: Scenario, speed: float
) -> float | None:
    """Return the time of the last agent to arrive over its straight flight, summed over all legs.

    Args:
        steps: Steps of a summary, with agents and times.
        scenario: Straight distances, in the order of each agent's steps.
        speed: m/s.

    Returns:
        The ratio; None if an agent did not arrive.
    """
    flights: dict[str, list[float]] = {f"d{i + 1}": [] for i in range(len(scenario.starts))}
    for step in steps:
        if step["verb"] == "goto" and step["outcome"] == "success":
            for name in step["agents"]:
                flights[name].append(step["ended_s"] - step["begun_s"])
    if any(len(times) != len(scenario.legs) for times in flights.values()):
        return None
    took = least = 0.0
    for leg, ways in enumerate(scenario.straight()):
        last, way = max(
            zip((times[leg] for times in flights.values()), ways, strict=True),
            key=lambda flight: flight[0],
        )
        took += last
        least += way / speed
    return took / least if least > 0 else None


def path_ratio(flown: Mapping[str, float], scenario: Scenario) -> float | None:
    """Return the distance flown by all agents over their straight distances.

    Args:
        flown: Distance of each agent from take-off to landing, m. The vertical climb and descent
            are subtracted.
        scenario: The scenario flown.
    """
    straight = sum(map(sum, scenario.straight()))
    upright = sum(scenario.heights) + sum(z for _, _, z in scenario.legs[-1])
    if len(flown) != len(scenario.starts) or straight == 0:
        return None
    return (sum(flown.values()) - upright) / straight


def _json(text: str | None, otherwise: Any = None) -> Any:
    return json.loads(text) if text else otherwise
