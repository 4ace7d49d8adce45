"""Dense swarms whose positions drift: agents land before they touch."""

from __future__ import annotations

from pathlib import Path

from star_bench.files import Campaign, write
from star_bench.scenarios import Case
from star_core import Registry, fly, load


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
