"""A scenario as mission and world files for `star check` and `star run`."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

from star_bench.catalogue import Case
from star_bench.scenario import CEILING, HIGH, LOW, Point, Scenario

SPEED: Final = 0.5  # m/s
ACCELERATION: Final = 2.0  # m/s²: the limits of the repository's missions
RATE: Final = 20  # Hz
PATIENCE: Final = 4.0
"""Timeout of a leg as a multiple of its longest straight flight, plus `GRACE`."""
GRACE: Final = 20.0  # s: the last agent has waited for all others

NOISE_FREE: Final = {"use": "sim", "noise": False}


def mission_text(case: Case, scenario: Scenario) -> str:
    """Return the mission of a case and its scenario; its world is ``worlds/NAME``."""
    names = [f"d{i + 1}" for i in range(len(scenario.starts))]
    lines = [
        f"# {scenario.about} Written by `star bench`, seed {case.seed}.",
        "star: 1",
        f"name: {case.name}",
        f"world: worlds/{case.name}.yaml",
        f"seed: {case.seed}",
        f"rate: {RATE}",
        f"limits: {{speed: {SPEED}, acceleration: {ACCELERATION}, height: [{LOW}, {HIGH}]}}",
        "swarm:",
        *(
            f"  {name}: {{start: {_point((*start, 0.0))}}}"
            for name, start in zip(names, scenario.starts, strict=True)
        ),
        f"transport: {_flow(NOISE_FREE)}",
        "localizer: flow",
        f"planner: {planner(scenario)}",
        "avoider: orca",
        "mission:",
        *_takeoff(names, scenario.heights),
        *_legs(names, scenario),
        "  - land: {}",
    ]
    return "\n".join(lines) + "\n"


def world_text(case: Case, scenario: Scenario) -> str:
    """Return the world of a case and its scenario."""
    low, high = _point((*scenario.low, 0.0)), _point((*scenario.high, CEILING))
    lines = [
        f"# {scenario.about} Written by `star bench`, seed {case.seed}.",
        "star: 1",
        f"name: {case.name}",
        f"fence: {{low: {low}, high: {high}}}",
    ]
    if scenario.obstacles:
        lines.append("obstacles:")
        lines += [f"  {name}: {_flow(given)}" for name, given in scenario.obstacles.items()]
    return "\n".join(lines) + "\n"


def planner(scenario: Scenario) -> str:
    """Return the planner: `straight` unless there are obstacles."""
    return "visibility" if scenario.obstacles else "straight"


def _takeoff(names: Sequence[str], heights: Sequence[float]) -> Iterator[str]:
    if len(set(heights)) == 1:
        yield f"  - takeoff: {{height: {_number(heights[0])}}}"
        return
    yield "  - parallel:"
    for height in sorted(set(heights)):
        there = [name for name, z in zip(names, heights, strict=True) if z == height]
        agents = ", ".join(there)
        yield f"      - takeoff: {{agents: [{agents}], height: {_number(height)}}}"


def _legs(names: Sequence[str], scenario: Scenario) -> Iterator[str]:
    for goals, ways in zip(scenario.legs, scenario.straight(), strict=True):
        timeout = math.ceil(PATIENCE * max(ways) / SPEED + GRACE)
        yield "  - parallel:"
        for name, goal in zip(names, goals, strict=True):
            yield f"      - goto: {{agents: {name}, to: {_point(goal)}, timeout: {timeout}}}"


def _point(point: Point | Iterable[float]) -> str:
    return "[" + ", ".join(_number(value) for value in point) + "]"


def _flow(value: Any) -> str:
    """Return a value as one line of YAML, lengths rounded to a millimeter."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(inner) for inner in value) + "]"
    return _number(value) if isinstance(value, float) else json.dumps(value).strip('"')


def _number(value: float) -> str:
    return str(round(float(value), 3) + 0.0)  # no -0.0
