"""Heights over a table, by each localizer that corrects them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from star_core import AgentPhase, Registry, Tick, fly, hookimpl, load

WORLD = """\
star: 1
name: table
fence: {low: [-3, -3, 0], high: [3, 3, 3]}
obstacles: {table: {box: {centre: [0, 0], size: [0.8, 2]}, height: [0, 0.6]}}
base_stations:
  bs1: {at: [-1.9, -1.9, 2.1], yaw_deg: 45, pitch_deg: 30}
  bs2: {at: [1.9, 1.9, 2.1], yaw_deg: -135, pitch_deg: 30}
anchors:
  a0: {at: [-2.2, -2.2, 0.2]}
  a1: {at: [2.2, -2.2, 0.2]}
  a2: {at: [2.2, 2.2, 0.2]}
  a3: {at: [-2.2, 2.2, 2.4]}
  a4: {at: [2.2, 2.2, 2.4]}
"""
MISSION = """\
star: 1
name: over
world: table.yaml
seed: 1
swarm: {cf1: {start: [-0.8, 0, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: none
mission:
  - takeoff: {height: 1.0, speed: 0.5}
  - goto: {to: [0.8, 0, 1.0]}
  - land: {speed: 0.5}
"""
MOCAP = "transport={use: sim, positioning: {std: 0.002}}"


def receives(system: str, flow_deck: str = "true") -> tuple[str, ...]:
    """Return the changes with which drones are located by a system on board."""
    return (
        f"transport={{use: sim, onboard: {{system: {system}, flow_deck: {flow_deck}}}}}",
        f"localizer={{use: onboard, system: {system}}}",
    )


class Heights:
    """Notes errors of heights in flight, and the true ones, m."""

    def __init__(self) -> None:
        self.error = 0.0
        self.above_table = np.inf

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        assert tick.truth is not None
        if tick.health.phase[0] == AgentPhase.FLYING:
            x, _, z = tick.truth.position[0]
            self.error = max(self.error, abs(float(tick.estimate.position[0, 2] - z)))
            if abs(x) < 0.4:
                self.above_table = min(self.above_table, float(z) - 0.6)


OTHERS = {
    "mocap forwarded": (MOCAP, "localizer={use: mocap, forward: extpose}"),
    **{system: receives(system) for system in ("lighthouse", "loco", "poses")},
    "no Flow deck": receives("lighthouse", "false"),
}


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param((), id="flow"),
        pytest.param((MOCAP, "localizer=mocap"), id="mocap"),
        *(
            pytest.param(changes, marks=pytest.mark.extended, id=name)
            for name, changes in OTHERS.items()
        ),
    ],
)
def test_a_flight_over_a_table_keeps_its_height(changes: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "table.yaml").write_text(WORLD)
    (tmp_path / "over.yaml").write_text(MISSION)
    heights = Heights()
    registry = Registry(heights)
    summary = fly(load(tmp_path / "over.yaml", registry, changes), registry)
    assert (summary["outcome"], summary["collisions"]["agent_obstacle"]) == ("completed", 0)
    assert summary["distances_from"] == "ground_truth"
    assert heights.error < 0.1
    assert heights.above_table > 0.1
