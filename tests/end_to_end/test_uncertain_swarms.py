"""Swarms whose positions drift: agents land before they touch, and not without a reason."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from star_bench.files import Campaign, write
from star_bench.scenarios import Case
from star_core import Registry, fly, load
from tests.campaign.safe_defaults import missions, room


@pytest.mark.extended
def test_agents_that_drift_into_each_other_land_apart(tmp_path: Path) -> None:
    case = Case("crossing", 8, 0, {})
    write(Campaign((case,), {"orca": "orca"}, ()), tmp_path)
    mission = tmp_path / "missions" / f"{case.name}.yaml"
    registry = Registry()
    flight = fly(load(mission, registry, ["transport=sim"]), registry)
    assert flight["collisions"]["agent_agent"] == 0  # two if all flew on
    assert flight["min_separation_m"] > 0.2
    assert flight["outcome"] == "failed"
    assert flight["reason"].endswith("were too uncertain and landed early")


@pytest.mark.extended
@pytest.mark.parametrize("seed", [22, 31])
def test_fault_free_formations_keep_their_agents(tmp_path: Path, seed: int) -> None:
    mission, half = missions()["wide-formation-10"]
    once = mission | {"mission": [*mission["mission"][:1], *first_leg(mission), {"land": {}}]}
    (tmp_path / mission["world"]).write_text(json.dumps(room(half)))
    (tmp_path / "mission.yaml").write_text(json.dumps(once))
    registry = Registry()
    flight = fly(load(tmp_path / "mission.yaml", registry, [f"seed={seed}"]), registry)
    assert flight["outcome"] == "completed"
    assert flight["reason"] == ""


def first_leg(mission: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the first formation of a mission that repeats two."""
    steps: list[dict[str, Any]] = mission["mission"][1]["repeat"]["steps"]
    return steps[:1]
