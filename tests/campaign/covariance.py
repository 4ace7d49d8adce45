"""How often errors of positions exceed their covariances, where tags are few.

It flies the paper's three missions with tags that are found geometrically, and only where a
detector would find them: between landmarks odometry is all there is. Of every tick in the air the
estimate's error in the plane is held against its covariance. If errors were normal and the
covariance right, 0.27 % would be beyond three deviations (a squared distance of 11.83), and the
mean squared distance, a degree of freedom, would be 1. The mission `TURNS`, in which drones turn
between tags that they lose, is flown in the default world.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from star_core import AgentPhase, Array, Registry, Tick, fly, hookimpl, load
from star_core.discovery import Source

MISSIONS = Path(__file__).parents[2] / "missions"
PATHS = ("paper_box", "paper_circle", "paper_figure8", "turns")
SEEDS = 4
BEYOND = 11.83  # squared, of two degrees of freedom: what three deviations are of one
GOAL = 1.0  # % beyond
STARTS = [(x, y) for x in (-4.0, 0.0, 4.0) for y in (-4.0, 0.0, 4.0)]
TURNS: dict[str, Any] = {
    "star": 1,
    "name": "turns",
    "world": "world.yaml",
    "swarm": {f"cf{k}": {"start": [*at, 0.0], "camera": "aideck"} for k, at in enumerate(STARTS)},
    "transport": {"use": "sim", "camera": {"mode": "geometric"}},
    "localizer": "apriltag",
    "planner": "straight",
    "avoider": "none",
    "mission": [
        {"takeoff": {"height": 0.5}},
        {"goto": {"agents": "all", "by": [-0.2, 0.0, 0.0], "yaw_deg": 90}},
        {"wait": {"until": {"elapsed": 2}}},
        {"goto": {"agents": "all", "by": [-2.0, 0.0, 0.0], "yaw_deg": 180}},
        {"goto": {"agents": "all", "by": [0.5, 1.0, 0.0], "yaw_deg": 0}},
        {"land": {}},
    ],
}
ROOM: dict[str, Any] = {
    "star": 1,
    "name": "tags",
    "fence": {"low": [-8, -8, 0], "high": [8, 8, 3]},
    "landmarks": {
        f"tag{k}": {"tags": [k], "at": [-7 + 1.2 * (k % 12), -7 + 1.2 * (k // 12), 0]}
        for k in range(144)
    },
}


class Watch:
    """Keeps how far off every estimate is.

    Attributes:
        squared: Squared distances in the plane, m².
        surprise: The same over the covariance.
    """

    def __init__(self) -> None:
        self.squared: list[float] = []
        self.surprise: list[float] = []

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        if tick.truth is None:
            return
        for row in np.flatnonzero(tick.health.phase == AgentPhase.FLYING).tolist():
            off: Array = (tick.estimate.position[row] - tick.truth.position[row])[:2]
            covariance = tick.estimate.covariance[row, :2, :2]
            self.squared.append(float(off @ off))
            self.surprise.append(float(off @ np.linalg.solve(covariance, off)))


def main() -> None:
    """Print a table, or with ``--json`` one object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="how many; default %(default)s")
    arguments = parser.parse_args()
    figures = {name: judged(name, arguments.seeds) for name in PATHS}
    if arguments.json:
        print(json.dumps(figures))
        return
    print(f"{'':14} {'rms, m':>8} {'NEES':>6} {'beyond, %':>10}   (goal: at most {GOAL:g})")
    for name, (rms, nees, beyond) in figures.items():
        print(f"{name:14} {rms:8.3f} {nees:6.2f} {beyond:10.2f}")


def judged(name: str, seeds: int) -> tuple[float, float, float]:
    """Return the root mean square error, m, the NEES, and the share beyond, %, of one path."""
    watch = Watch()
    with TemporaryDirectory() as folder:
        path, changes = MISSIONS / f"{name}.yaml", ["localizer.processes=0"]
        if name == TURNS["name"]:
            path = Path(folder) / "turns.yaml"
            path.write_text(json.dumps(TURNS))
            (Path(folder) / "world.yaml").write_text(json.dumps(ROOM))
        else:
            changes += ["transport.camera.mode=geometric"]
            changes += ["transport.profile=ideal", "transport.controller=ideal"]
        for seed in range(seeds):
            registry = Registry()
            registry.add(watch, Source("benchmark:watch", "0"))
            fly(load(path, registry, [f"seed={seed}", *changes]), registry)
    surprise = np.array(watch.surprise)
    return (
        float(np.sqrt(np.mean(watch.squared))),
        float(surprise.mean() / 2),
        float(100 * (surprise > BEYOND).mean()),
    )


if __name__ == "__main__":
    main()
