"""Speed and memory of a whole mission of 1000 drones that take off, cross and land.

``python benchmarks/tick.py`` prints a table, with ``--json`` one JSON object. Two blocks of drones
fly through each other: every tick locates, plans, avoids, filters and simulates all of them, on an
estimate that errs by 3 cm along each axis, correlated over 1 s, at the default margins. Blocks of
fewer drones (``--agents``) are as deep, but have fewer lanes. The peer is real time; the clock is
that of the processor, all threads together, so that the figure is that of one core.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

from printed import command_line, show

from star_core import Registry, fly, hookimpl, load

AGENTS = 1000
ROWS = 20  # of each block
PITCH = 1.0  # m, between neighbours in a lane of a block
ASIDE = 1.5  # m, between lanes of a block; those of the other one lie halfway
JITTER = 0.1  # m, along each axis
GAP = 2.0  # m, between the blocks
SPEED = 0.5  # m/s, the default
HEIGHT = 1.0  # m

HEAD = """\
star: 1
name: thousand
world: room.yaml
limits: {{speed: {speed}, acceleration: 2.0, height: [0.3, 1.8]}}
transport: {{use: sim, noise: false, profile: ideal, controller: ideal}}
localizer: {{use: flow, error_std: 0.03, error_time_constant: 1.0}}
planner: straight
avoider: orca
swarm:
"""
STEPS = """\
groups:
  west: [{west}]
  east: [{east}]
mission:
  - takeoff: {{height: {height}}}
  - parallel:
      - goto: {{agents: west, by: [{way}, 0, 0]}}
      - goto: {{agents: east, by: [-{way}, 0, 0]}}
  - land: {{}}
"""


class Clock:
    """Reads the processor's clock and the peak of memory when a mission begins and when it ends."""

    def __init__(self) -> None:
        self.begun = self.took = 0.0  # s
        self.peak = 0.0  # MB

    @hookimpl
    def star_mission_started(self) -> None:
        self.begun = time.process_time()

    @hookimpl
    def star_mission_ended(self) -> None:
        self.took = time.process_time() - self.begun
        self.peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


def write(folder: Path, agents: int = AGENTS) -> Path:
    """Write the mission of so many agents and its world, and return the mission's file."""
    rng = Random(0)  # noqa: S311 -- no secret
    way, lanes = ROWS * PITCH + GAP, agents // (2 * ROWS)
    lines, blocks = [], {"west": [], "east": []}  # type: ignore[var-annotated]
    for name, block in blocks.items():
        side = -1 if name == "west" else 1
        for i in range(ROWS * lanes):
            row, lane = divmod(i, lanes)
            x = side * (GAP / 2 + row * PITCH) + JITTER * (2 * rng.random() - 1)
            y = (lane + side / 4) * ASIDE + JITTER * (2 * rng.random() - 1)
            block.append(f"{name}{i + 1}")
            lines.append(f"  {name}{i + 1}: {{start: [{x:.3f}, {y:.3f}, 0.0]}}")
    far, wide = way + 2, lanes * ASIDE
    (folder / "room.yaml").write_text(
        f"star: 1\nname: room\nfence: {{low: [{-far}, -3, 0], high: [{far}, {wide + 2}, 2.5]}}\n"
    )
    mission = folder / "thousand.yaml"
    steps = {name: ", ".join(names) for name, names in blocks.items()}
    mission.write_text(
        HEAD.format(speed=SPEED)
        + "\n".join(lines)
        + "\n"
        + STEPS.format(height=HEIGHT, way=way, **steps)
    )
    return mission


def measure(agents: int = AGENTS) -> tuple[dict[str, float], Mapping[str, Any]]:
    """Fly the mission of so many agents; return the figures by name, and its summary.

    Raises:
        SystemExit: It did not complete, or drones collided.
    """
    clock = Clock()
    registry = Registry(clock)
    with TemporaryDirectory() as folder:
        began = time.process_time()
        mission = load(write(Path(folder), agents), registry)
        read = time.process_time() - began
        summary = fly(mission, registry)
    if summary["outcome"] != "completed" or summary["collisions"]["agent_agent"]:
        sys.exit(f"{summary['outcome']}: {summary['reason']}; {summary['collisions']}")
    parts = {f"{part} (us)": took for part, took in summary["compute_us"].items()}
    figures = {
        "agents": float(len(summary["agents"])),
        "times real time on one core": summary["flight_time_s"] / clock.took,
        "peak memory (MB)": clock.peak,
        "least separation (m)": summary["min_separation_m"],
        "flight (s)": summary["flight_time_s"],
        "reading the mission (s)": read,
        **parts,
    }
    return figures, summary


def main() -> None:
    """Print the figures."""
    options = command_line(__doc__, agents=AGENTS).parse_args()  # a multiple of 40
    figures, _ = measure(options.agents)
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
