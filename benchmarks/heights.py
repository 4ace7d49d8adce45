"""Contacts and height errors of flights over a table, for several heights and clearances.

``python benchmarks/heights.py`` flies one drone with a Flow deck over a table and back, once per
seed, and prints for each height of the table and each clearance above it how many flights complete
without a contact, the greatest height error, how far the drone sinks below its path at most, and by
how much its error along the path changes from `BEFORE` an edge until `AFTER` it (RMS). ``--tops 0``
flies without a table, as a comparison for the latter.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from star_core import AgentPhase, Registry, Tick, fly, hookimpl, load

WORLD = "star: 1\nname: table\nfence: {low: [-3, -3, 0], high: [3, 3, 3]}\n"
TABLE = (
    "obstacles: {{table: {{box: {{centre: [0, 0], size: [{width}, 2]}}, height: [0, {top}]}}}}\n"
)
BEFORE, AFTER = 3, 10  # ticks: 0.15 and 0.5 s
MISSION = """\
star: 1
name: over
world: table.yaml
limits: {{speed: 0.5, height: [0.2, 2.5], uncertainty_margin: 0}}
swarm: {{cf1: {{start: [-1.2, 0, 0]}}}}
transport: sim
localizer: flow
planner: straight
avoider: none
mission:
  - takeoff: {{height: {height}}}
  - goto: {{to: [1.2, 0, {height}]}}
  - goto: {{to: [-1.2, 0, {height}]}}
  - land: {{}}
"""


class Heights:
    """Notes the true and the estimated x and z of the drone in flight, tick by tick, m."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        if tick.truth is not None and tick.health.phase[0] == AgentPhase.FLYING:
            poses = tick.truth.position[0, [0, 2]], tick.estimate.position[0, [0, 2]]
            self.rows.append((*poses[0].tolist(), *poses[1].tolist()))


def main() -> None:
    """Fly, and print a line for each height, width and clearance."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seeds", type=int, default=10)
    options.add_argument("--tops", type=float, nargs="+", default=[0.3, 0.6, 0.9])
    options.add_argument("--clearances", type=float, nargs="+", default=[0.2, 0.3, 0.4, 0.5])
    options.add_argument("--widths", type=float, nargs="+", default=[0.1, 1.0])
    line = options.parse_args()
    print("top  width  clearance  completed without a contact  height error  sinks by  edge")
    for top in line.tops:
        for width in line.widths:
            for clearance in line.clearances:
                print(_case(top, width, clearance, line.seeds), flush=True)


def _case(top: float, width: float, clearance: float, seeds: int) -> str:
    height = top + clearance
    good, error, sunk = 0, 0.0, 0.0
    changes: list[float] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        table = TABLE.format(top=top, width=width) if top else ""
        (folder / "table.yaml").write_text(WORLD + table)
        (folder / "over.yaml").write_text(MISSION.format(height=height))
        for seed in range(1000, 1000 + seeds):
            notes = Heights()
            registry = Registry(notes)
            summary = fly(load(folder / "over.yaml", registry, [f"seed={seed}"]), registry)
            good += summary["outcome"] == "completed"
            x, z, estimated_x, estimated_z = np.array(notes.rows).T
            over = np.abs(x) < width / 2 + 0.4  # where the crossings are
            error = max(error, float(np.abs(estimated_z - z)[over].max(initial=0.0)))
            sunk = max(sunk, float((height - z)[over].max(initial=0.0)))
            edges = np.flatnonzero(np.diff(np.abs(x) < width / 2))
            edges = edges[edges < len(x) - AFTER]
            drift = estimated_x - x
            changes += (drift[edges + AFTER] - drift[edges - BEFORE]).tolist()
    edge = float(np.sqrt(np.mean(np.square(changes)))) if changes else np.nan
    figures = f"{error:.2f}  {sunk:.2f}  {edge:.3f}"
    return f"{top:.1f}  {width:.1f}  {clearance:.1f}  {good} of {seeds}  {figures}"


if __name__ == "__main__":
    main()
