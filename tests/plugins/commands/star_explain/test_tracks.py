"""Where agents are during a dry run."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from star_core import AgentPhase, Registry, load
from star_core.testing import scene
from star_explain.dry_run import dry_run_with_tracks
from star_explain.tracks import Tracks

MISSION = """\
star: 1
name: turns
world: hall.yaml
swarm: {a: {start: [0, 0, 0]}, b: {start: [0, 3, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 0.8}
  - goto: {agents: a, to: [5, 0, 0.8], speed: 0.2}
  - goto: {agents: b, to: [5, 3, 0.8]}
  - land: {}
"""
WORLD = "star: 1\nname: hall\nfence: {low: [-9, -9, 0], high: [9, 9, 3]}\n"


def test_agents_hover_where_their_last_step_ended(tmp_path: Path) -> None:
    (tmp_path / "hall.yaml").write_text(WORLD)
    (tmp_path / "turns.yaml").write_text(MISSION)
    registry = Registry()
    _, tracks, _ = dry_run_with_tracks(load(tmp_path / "turns.yaml", registry), registry)
    time, position, _, airborne = tracks.sampled(0.5)
    waits = (time > 5.0) & (time < 25.0)
    assert airborne[waits].all()
    assert np.allclose(position[waits, 1], [0.0, 3.0, 0.8], atol=0.06)  # b, while a flies
    stays = (time > 32.0) & (time < 36.0)
    assert np.allclose(position[stays, 0], [5.0, 0.0, 0.8], atol=0.11)


def test_a_repeated_track_begins_where_it_ended() -> None:
    tracks = Tracks(scene(1))
    flying = np.array([int(AgentPhase.FLYING)])
    marks = tracks.marks()
    for k in range(1, 8):
        tracks.add(0.1 * k, (0,), np.array([[0.1 * k, 0.0, 1.0]]), np.zeros(1), flying)
    tracks.repeat(marks, 2, 0.7)
    time, position, _, _ = tracks.sampled(0.7)
    assert np.allclose(time[:3], [0.0, 0.7, 1.4])
    assert np.allclose(position[1:3, 0], [0.7, 0.0, 1.0])
