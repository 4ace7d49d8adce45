"""How precisely drones fly a trajectory in its own time.

``python benchmarks/tracking.py figure8.csv`` flies a file of Crazyswarm2's format in the simulator,
steered by setpoints, and prints for each kind of flight the error of the true position at equal
times: RMS and greatest, m, the share of the time beyond 0.15 m, which Crazyswarm2's system test
limits to 5 %, and what `star check` expects. ``positions`` are flights with noise in the default
world and a positioning system of 1 cm; ``flow`` the same without one, where drift dominates. ``on
board`` flies it without noise by the drone's own commander, from where the drone is at its start.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from star_core import Array, Registry, Tick, fly, hookimpl, load
from star_verbs.follow.files import read_trajectory
from star_verbs.follow.tracking_error import tracking_error
from star_verbs.follow.trajectory import PolynomialPath

LIMIT: Final = 0.15  # m
MISSION: Final = """\
star: 1
name: tracking
world: room.yaml
limits: {speed: 1.6, acceleration: 4.0}
swarm: {cf1: {start: [0, 0, 0]}}
transport: sim
localizer: flow
planner: straight
avoider: orca
mission:
  - takeoff: {height: 1.0}
  - hold: {for: 2}
  - follow: {file: path.csv, format: poly7}
  - land: {}
"""
WORLD: Final = "star: 1\nname: room\nfence: {low: [-4, -4, 0], high: [4, 4, 3]}\n"
EXACT: Final = ("transport.noise=false",)
FLIGHTS: Final = {
    "pid": EXACT,
    "mellinger": (*EXACT, "transport.controller=mellinger"),
    "ideal": (*EXACT, "transport.profile=ideal", "transport.controller=ideal"),
    "positions": ("transport={use: sim, positioning: {std: 0.01}}", "localizer=mocap"),
    "positions, mellinger": (
        "transport={use: sim, controller: mellinger, positioning: {std: 0.01}}",
        "localizer=mocap",
    ),
    "flow": (),
    "on board, mellinger": (*EXACT, "transport.controller=mellinger"),
}
ON_BOARD: Final = "on board"  # how names of flights by the drone's own commander begin


class Track:
    """Distances of the drone from where the trajectory leads, m, while it is flown.

    Args:
        path: What the drone's own commander flies; None if setpoints lead it.
    """

    def __init__(self, path: PolynomialPath | None = None) -> None:
        self.error: list[float] = []
        self._path = path
        self._begun: tuple[float, Array] | None = None  # s, and the trajectory's origin, m

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        if tick.truth is None:
            return
        position, goal = tick.truth.position[0], None
        if self._path is None:
            goal = tick.goals.position[0] if tick.goals.acceleration is not None else None
        elif "follow" in tick.doing:
            time, origin = self._begun = self._begun or (tick.time, position)
            passed = np.array([min(tick.time - time, self._path.length)])
            goal = origin + self._path.at(passed)[0][0] - self._path.at(np.zeros(1))[0][0]
        if goal is not None:
            self.error.append(float(np.linalg.norm(position - goal)))


def errors(
    folder: Path, changes: tuple[str, ...], seeds: int, path: PolynomialPath | None = None
) -> np.ndarray:
    """Return the distances of flights with some seeds; without noise of one."""
    tracks = []
    mission = folder / ("mission.yaml" if path is None else "on-board.yaml")
    for seed in range(1, 2 if EXACT[0] in changes else seeds + 1):
        track = Track(path)
        registry = Registry(track)
        summary = fly(load(mission, registry, [f"seed={seed}", *changes]), registry)
        if summary["outcome"] != "completed":
            raise SystemExit(summary["reason"])
        tracks += track.error
    return np.array(tracks)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--seeds", type=int, default=8, help="%(default)s")
    arguments = parser.parse_args()
    path = read_trajectory(arguments.file, arguments.file.name, "poly7")
    expected = tracking_error(path, 1.0, 0.05, on_board=False)
    print(f"{'':22}{'RMS':>7}{'most':>7}{'beyond':>8}")
    print(f"{'expected':22}{expected.rms:7.3f}{expected.most:7.3f}")
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "room.yaml").write_text(WORLD)
        (folder / "mission.yaml").write_text(MISSION)
        (folder / "on-board.yaml").write_text(MISSION.replace("poly7}", "poly7, on_board: true}"))
        (folder / "path.csv").write_text(arguments.file.read_text())
        for kind, changes in FLIGHTS.items():
            flown = path if kind.startswith(ON_BOARD) else None
            error = errors(folder, changes, arguments.seeds, flown)
            rms, beyond = np.sqrt(np.mean(error**2)), np.mean(error > LIMIT)
            print(f"{kind:22}{rms:7.3f}{error.max():7.3f}{beyond:8.1%}", flush=True)


if __name__ == "__main__":
    main()
