"""How precisely drones of ``star fleet`` fly a trajectory in its own time.

``python -m tests.campaign.tracking_fleet figure8.csv`` flies a file of Crazyswarm2's format by the
transport `radio` over the fleet's protocols, in the default world, by a simulated motion capture of
1 cm, on a virtual clock, and prints for each controller the error of the true position at equal
times, as ``benchmarks/tracking.py`` does for the simulator: RMS and greatest, m, and the share of
the time beyond 0.15 m, which Crazyswarm2's system test limits to 5 %.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from star_core import Registry, Tick, fly, hookimpl, load
from star_core.toolkit import fill_defaults
from star_sim import OPTIONS, simulator_arguments
from tests.campaign.mocap_fleet import WORLD, motion_capture
from tests.end_to_end.virtual_air import Air

LIMIT: Final = 0.15  # m
POSITIONING: Final = {"std": 0.01}
MISSION: Final = """\
star: 1
name: tracking
world: hall.yaml
limits: {speed: 1.6, acceleration: 4.0}
swarm: {cf1: {start: [0, 0, 0], uri: "udp://air:1"}}
transport: {use: radio, guardian: false}
localizer: {use: mocap, source: {natnet: {host: fleet}}}
planner: straight
avoider: orca
mission:
  - takeoff: {height: 1.0}
  - hold: {for: 2}
  - follow: {file: path.csv, format: poly7}
  - land: {}
"""
CONTROLLERS: Final = {
    "pid": (),
    "mellinger": (
        "transport.setpoints=full-state",
        "transport.parameters={stabilizer.controller: 2}",
    ),
}


class Track:
    """Distances of the drone from where the trajectory leads, m, while it is flown."""

    def __init__(self, air: Air) -> None:
        self.error: list[float] = []
        self._air = air

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        if tick.goals.acceleration is not None:
            away = self._air.drones["position"][0] - tick.goals.position[0]
            self.error.append(float(np.linalg.norm(away)))


def errors(folder: Path, changes: tuple[str, ...], seed: int) -> list[float]:
    """Return the distances of one flight, m."""
    options: dict[str, Any] = fill_defaults({"positioning": POSITIONING, "speed": 1.0}, OPTIONS)
    changes = (f"seed={seed}", f"transport.cache={folder}/tables", *changes)
    path = folder / "mission.yaml"
    scene = load(path, Registry(), changes).scene
    air = Air(scene, seed=seed, **simulator_arguments(**options))
    track = Track(air)
    registry = Registry(track)
    with motion_capture(air):
        summary = fly(load(path, registry, changes), registry)
    if summary["outcome"] != "completed":
        raise SystemExit(summary["reason"])
    return track.error


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--seeds", type=int, default=8, help="%(default)s")
    arguments = parser.parse_args()
    print(f"{'':12}{'RMS':>7}{'most':>7}{'beyond':>8}")
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "hall.yaml").write_text(WORLD)
        (folder / "mission.yaml").write_text(MISSION)
        (folder / "path.csv").write_text(arguments.file.read_text())
        for controller, changes in CONTROLLERS.items():
            flown = [errors(folder, changes, seed) for seed in range(1, arguments.seeds + 1)]
            error = np.concatenate(flown)
            rms, beyond = np.sqrt(np.mean(error**2)), np.mean(error > LIMIT)
            each = " ".join(f"{np.mean(np.array(distances) > LIMIT):.1%}" for distances in flown)
            print(f"{controller:12}{rms:7.3f}{error.max():7.3f}{beyond:8.1%}  ({each})", flush=True)


if __name__ == "__main__":
    main()
