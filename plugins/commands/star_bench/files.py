"""Files of a campaign: a mission and a world for each case, and the study that flies them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from star_bench.scenario import CEILING, HIGH, LOW, Scenario
from star_bench.scenarios import Case
from star_bench.table import COUNTS
from star_core.toolkit import Progress

IDEAL: Final = {"use": "sim", "noise": False, "profile": "ideal", "controller": "ideal"}


def _measured(transport: Mapping[str, Any], std: float) -> Mapping[str, Any]:
    """Return overrides for positions measured with a standard deviation, m."""
    positioning = {"std": std, "correlation_time": 1.0}
    return {"transport": {**transport, "positioning": positioning}, "localizer": {"use": "mocap"}}


SETTINGS: Final[Mapping[tuple[str, str], Mapping[str, Any]]] = {
    ("ideal", "exact"): {},
    ("ideal", "bounded"): _measured(IDEAL, 0.03),
    ("default", "exact"): _measured({"use": "sim"}, 0.001),
    ("default", "bounded"): _measured({"use": "sim"}, 0.03),
    ("default", "flow"): {"transport": {"use": "sim"}},
}
"""Overrides of a mission, in the ideal world with exact positions, by world and positions.

Bounded positions are those of a positioning system with a standard deviation of 3 cm along each
axis; in the default world one of 1 mm stands for exact ones. In the ideal world `flow` is exact."""
WORLDS: Final = tuple(dict.fromkeys(world for world, _ in SETTINGS))
POSITIONS: Final = tuple(dict.fromkeys(positions for _, positions in SETTINGS))

MEASURES: Final = (
    *COUNTS.values(),
    "flight_time_s",
    "corrected",
    "compute_us",
    "steps",
    "path_length_m.per_agent",
)
AVOIDER, SETTING = FACTORS = "avoider", "setting"  # of the study
STUDY: Final = "study.yaml"
MISSIONS: Final = "missions"

SPEED: Final = 0.5  # m/s
ACCELERATION: Final = 2.0  # m/s²: the limits of the repository's missions
RATE: Final = 20  # Hz
TIMEOUT_FACTOR: Final = 4.0  # of a leg, times its longest straight flight
TIMEOUT_MARGIN: Final = 20.0  # s: the last agent has waited for all others


@dataclass(frozen=True, slots=True)
class Campaign:
    """Every case with every avoider in every setting.

    Attributes:
        cases: The missions.
        avoiders: Overrides for each avoider, by label.
        settings: Keys of `SETTINGS`: world and positions.
    """

    cases: Sequence[Case]
    avoiders: Mapping[str, Any]
    settings: Sequence[tuple[str, str]]

    @property
    def runs(self) -> int:
        """Number of flights."""
        return len(self.cases) * len(self.avoiders) * len(self.settings)


def write(campaign: Campaign, folder: Path) -> Path:
    """Write the files of a campaign into `folder` and return the study's.

    Raises:
        OSError: They cannot be written.
    """
    worlds = folder / MISSIONS / "worlds"
    worlds.mkdir(parents=True, exist_ok=True)
    with Progress("writing", len(campaign.cases), unit="scenarios") as progress:
        for case in campaign.cases:
            scenario = case.draw()
            file = f"{case.name}.yaml"
            for path, lines in (
                (folder / MISSIONS / file, mission_lines(case, scenario)),
                (worlds / file, world_lines(case, scenario)),
            ):
                path.write_text(text(lines), encoding="utf-8")
            progress.done += 1
    study = folder / STUDY
    study.write_text(text(_study(campaign)), encoding="utf-8")
    return study


def _study(campaign: Campaign) -> Iterator[str]:
    yield "# Written by `star bench`; `star ablate` flies it."
    yield "star: 1"
    yield "name: bench"
    yield "seeds: own"
    yield "missions:"
    yield from (f"  - {MISSIONS}/{case.name}.yaml" for case in campaign.cases)
    yield "factors:"
    yield f"  {AVOIDER}:"
    for label, choice in campaign.avoiders.items():
        yield f"    {json.dumps(label)}: {json.dumps({'avoider': choice})}"
    yield f"  {SETTING}:"
    for setting in campaign.settings:
        yield f'    "{" ".join(setting)}": {json.dumps(SETTINGS[setting])}'
    yield f"measures: [{', '.join(MEASURES)}]"


def mission_lines(case: Case, scenario: Scenario) -> Iterator[str]:
    """Yield the mission of a case and its scenario; its world is ``worlds/NAME``."""
    names = [f"d{i + 1}" for i in range(len(scenario.starts))]
    yield f"# {scenario.about} Written by `star bench`, seed {case.seed}."
    yield "star: 1"
    yield f"name: {case.name}"
    yield f"world: worlds/{case.name}.yaml"
    yield f"seed: {case.seed}"
    yield f"rate: {RATE}"
    yield f"limits: {{speed: {SPEED}, acceleration: {ACCELERATION}, height: [{LOW}, {HIGH}]}}"
    yield "swarm:"
    for name, start in zip(names, scenario.starts, strict=True):
        yield f"  {name}: {{start: {_flow([*start, 0.0])}}}"
    yield f"transport: {_flow(IDEAL)}"
    yield "localizer: flow"
    yield f"planner: {'visibility' if scenario.obstacles else 'straight'}"
    yield "avoider: orca"
    yield "mission:"
    if len(set(scenario.heights)) == 1:
        yield f"  - takeoff: {{height: {_flow(scenario.heights[0])}}}"
    else:
        yield "  - parallel:"
        for height in sorted(set(scenario.heights)):
            agents = [n for n, z in zip(names, scenario.heights, strict=True) if z == height]
            yield f"      - takeoff: {{agents: {_flow(agents)}, height: {_flow(height)}}}"
    for goals, distances in zip(scenario.legs, scenario.straight(), strict=True):
        timeout = math.ceil(TIMEOUT_FACTOR * max(distances) / SPEED + TIMEOUT_MARGIN)
        yield "  - parallel:"
        for name, goal in zip(names, goals, strict=True):
            yield f"      - goto: {{agents: {name}, to: {_flow(goal)}, timeout: {timeout}}}"
    yield "  - land: {}"


def world_lines(case: Case, scenario: Scenario) -> Iterator[str]:
    """Yield the world of a case and its scenario."""
    low, high = _flow([*scenario.low, 0.0]), _flow([*scenario.high, CEILING])
    yield f"# {scenario.about} Written by `star bench`, seed {case.seed}."
    yield "star: 1"
    yield f"name: {case.name}"
    yield f"fence: {{low: {low}, high: {high}}}"
    if scenario.obstacles:
        yield "obstacles:"
        yield from (f"  {name}: {_flow(shape)}" for name, shape in scenario.obstacles.items())


def _flow(value: Any) -> str:
    """Return a value as one line of YAML, lengths rounded to a millimeter."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(inner) for inner in value) + "]"
    if isinstance(value, bool):
        return json.dumps(value)
    return str(round(float(value), 3) + 0.0) if isinstance(value, int | float) else str(value)


def text(lines: Iterable[str]) -> str:
    """Return lines as the text of a file."""
    return "\n".join(lines) + "\n"
