"""A benchmark campaign and its files: missions, worlds and the study that flies them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from star_bench.catalogue import Case
from star_bench.mission_file import mission_text, world_text

NOISE: Final[Mapping[str, Mapping[str, Any]]] = {
    "off": {},
    "on": {"localizer": {"use": "flow", "error_std": 0.03, "error_time_constant": 1.0}},
}
"""Estimation error: none, or 3 cm along each axis with a correlation time of 1 s."""

MEASURES: Final = (
    "collisions.agent_agent",
    "collisions.agent_obstacle",
    "deadlocks",
    "waits",
    "min_separation_m",
    "min_clearance_m",
    "flight_time_s",
    "corrected",
    "compute_us",
    "steps",
    "path_length_m.per_agent",
)
STUDY: Final = "study.yaml"
MISSIONS: Final = "missions"


@dataclass(frozen=True, slots=True)
class Campaign:
    """Every case with every avoider, with and without noise.

    Attributes:
        cases: The missions.
        avoiders: Overrides for each avoider, by label.
        noises: Keys of `NOISE`.
    """

    cases: Sequence[Case]
    avoiders: Mapping[str, Any]
    noises: Sequence[str]

    @property
    def runs(self) -> int:
        """Number of flights."""
        return len(self.cases) * len(self.avoiders) * len(self.noises)


def write(campaign: Campaign, folder: Path) -> Path:
    """Write the files of a campaign into `folder` and return the study's.

    Raises:
        OSError: They cannot be written.
    """
    worlds = folder / MISSIONS / "worlds"
    worlds.mkdir(parents=True, exist_ok=True)
    for case in campaign.cases:
        scenario = case.draw()
        file = f"{case.name}.yaml"
        (folder / MISSIONS / file).write_text(mission_text(case, scenario), encoding="utf-8")
        (worlds / file).write_text(world_text(case, scenario), encoding="utf-8")
    study = folder / STUDY
    study.write_text("\n".join(_study(campaign)) + "\n", encoding="utf-8")
    return study


def _study(campaign: Campaign) -> Iterator[str]:
    yield "# Written by `star bench`; `star ablate` flies it."
    yield "star: 1"
    yield "name: bench"
    yield "seeds: own"
    yield "missions:"
    yield from (f"  - {MISSIONS}/{case.name}.yaml" for case in campaign.cases)
    yield "factors:"
    yield "  avoider:"
    for label, given in campaign.avoiders.items():
        yield f"    {json.dumps(label)}: {json.dumps({'avoider': given})}"
    yield "  noise:"
    yield from (f'    "{noise}": {json.dumps(NOISE[noise])}' for noise in campaign.noises)
    yield f"measures: [{', '.join(MEASURES)}]"
