"""Metrics of one flight, from its row in the results of a study."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

from star_bench.scenario import Scenario

COMPUTED: Final = ("avoider", "localizer", "planner", "safety")  # of which the time is given
COUNTS: Final = {
    "agent-agent collisions": "collisions.agent_agent",
    "agent-obstacle collisions": "collisions.agent_obstacle",
    "deadlocks": "deadlocks",
    "waits": "waits",
    "min separation (m)": "min_separation_m",
    "min clearance (m)": "min_clearance_m",
}
"""Columns of a study's results, by the column of the table."""

Metrics: TypeAlias = Mapping[str, float | None]
"""Metrics of one flight, by the column of the table; None if unknown."""


def metrics(row: Mapping[str, str], scenario: Scenario, speed: float) -> Metrics:
    """Return the metrics of a row of ``results.csv``.

    Args:
        row: Texts by column.
        scenario: The scenario flown.
        speed: The mission's speed limit, m/s.
    """

    def value(column: str, default: Any = None) -> Any:
        return json.loads(text) if (text := row.get(column)) else default

    completed = row["outcome"] == "completed"
    counts = {name: value(column) for name, column in COUNTS.items()}
    hits = counts["agent-agent collisions"], counts["agent-obstacle collisions"]
    corrected, compute = value("corrected"), value("compute_us", {})
    lengths = value("path_length_m.per_agent", {})
    return counts | {
        "runs": 1,
        "success": float(completed and hits == (0, 0)),
        "time ratio": time_ratio(value("steps", []), scenario, speed),
        "path ratio": path_ratio(lengths, scenario) if completed else None,
        "corrected": sum(corrected.values()) if corrected else None,
        **{f"{plugin} (us)": compute.get(plugin) for plugin in COMPUTED},
    }


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
    for leg, distances in enumerate(scenario.straight()):
        times = [flight[leg] for flight in flights.values()]
        last = times.index(max(times))
        took += times[last]
        least += distances[last] / speed
    return took / least if least > 0 else None


def path_ratio(flown: Mapping[str, float], scenario: Scenario) -> float | None:
    """Return the distance flown by all agents over their straight distances.

    Args:
        flown: Distance of each agent from take-off to landing, m. The vertical climb and descent
            are subtracted.
        scenario: The scenario flown.
    """
    straight = sum(map(sum, scenario.straight()))
    vertical = sum(scenario.heights) + sum(z for _, _, z in scenario.legs[-1])
    if len(flown) != len(scenario.starts) or straight == 0:
        return None
    return (sum(flown.values()) - vertical) / straight
