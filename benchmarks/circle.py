"""A mission of drones on a circle that change sides, again and again."""

from __future__ import annotations

import math
from pathlib import Path

ROOM = "star: 1\nname: room\nfence: {low: [-4, -4, 0], high: [4, 4, 2.5]}\n"
MISSION = """\
star: 1
name: ten
world: room.yaml
transport: {transport}
localizer: flow
planner: straight
avoider: orca
swarm:
{swarm}mission:
  - takeoff: {{height: 0.8}}
{turns}  - land: {{}}
"""


def write(folder: Path, agents: int, radius: float, transport: str, turns: int) -> Path:
    """Write the mission and its world into a folder; return the mission's file.

    Args:
        folder: For the files.
        agents: Number of drones.
        radius: Of the circle, m.
        transport: As in the mission.
        turns: How often they change sides.
    """
    angles = [2 * math.pi * i / agents for i in range(agents)]
    places = [(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles]
    swarm = [f"  cf{i + 1}: {{start: [{x:.3f}, {y:.3f}, 0]}}\n" for i, (x, y) in enumerate(places)]
    lines = []
    for turn in range(turns):
        side = 1 if turn % 2 else -1
        lines.append("  - parallel:\n")
        lines += [
            f"      - goto: {{agents: cf{i + 1}, to: [{side * x:.3f}, {side * y:.3f}, 0.8]}}\n"
            for i, (x, y) in enumerate(places)
        ]
    (folder / "room.yaml").write_text(ROOM)
    mission = folder / "ten.yaml"
    mission.write_text(
        MISSION.format(transport=transport, swarm="".join(swarm), turns="".join(lines))
    )
    return mission
