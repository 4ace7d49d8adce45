"""Whether imported files of the original STAR fly to their ends, and touch no solid obstacle.

Of each launch folder every mission is imported into every environment and into none, as intended
and as executed, and each that is imported is flown once. Folders are drawn from seeds, or named on
the command line: the original's own are not part of the project. The judge is the simulator's
ground truth: the least distance of any drone to an obstacle that is not virtual, which the record
has, not the distance that the core counts collisions by.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely

from star_core import Registry, fly, load, read_run
from star_core.commands.main import main as star
from tests.plugins.formats.star_import.originals import launch_folder

RADIUS = 0.06  # m, of a drone: nearer than this to an obstacle it touches it
MODES: dict[str, tuple[str, ...]] = {"intended": (), "executed": ("--as-executed",)}
OPTIONS = ("transport.camera.mode=geometric",)


class Case(NamedTuple):
    """A mission in an environment, and what became of it.

    Attributes:
        name: Folder, mission, environment and mode.
        outcome: ``refused``, or that of the flight.
        reason: Why it was refused or failed.
        nearest: Least distance to a solid obstacle, m; inf without one or without a flight.
        touches: Number of collisions between agents.
        ended: Steps that were not aborted, and all steps.
    """

    name: str
    outcome: str
    reason: str
    nearest: float
    touches: int
    ended: tuple[int, int]


def main() -> int:
    """Print a line for every combination and a summary; 1 if a solid obstacle was touched."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, help="launch folders; drawn ones if none")
    parser.add_argument("--seeds", type=int, default=8, help="number of folders; %(default)s")
    parser.add_argument("--agent", action="append", default=[], help="agents that files lack")
    parser.add_argument("--no-flights", action="store_true", help="import only")
    arguments = parser.parse_args()
    cases = []
    with tempfile.TemporaryDirectory() as name:
        folders = arguments.folders or [
            launch_folder(Path(name, f"seed{seed}"), seed) for seed in range(arguments.seeds)
        ]
        for folder in folders:
            for case in flown(
                folder, arguments.agent, Path(name, "out"), fly_it=not arguments.no_flights
            ):
                print(case.name, case.outcome, f"{case.nearest:.2f}", case.reason, flush=True)
                cases.append(case)
    counts = Counter(case.outcome for case in cases)
    touched = [case for case in cases if case.nearest < RADIUS]
    print(f"combinations          {len(cases)}")
    for outcome, count in counts.most_common():
        print(f"{outcome:22}{count}")
    print(f"touched an obstacle   {len(touched)}")
    print(f"agents touched        {sum(case.touches > 0 for case in cases)}")
    print(f"nearest to an obstacle {min((case.nearest for case in cases), default=np.inf):.2f} m")
    return 1 if touched else 0


def flown(folder: Path, agents: Sequence[str], out: Path, *, fly_it: bool) -> Iterator[Case]:
    """Import and fly every mission of a folder in every environment and mode.

    Args:
        folder: With its files.
        agents: ``NAME=X,Y`` each, for missions that name them.
        out: Folder for what is imported.
        fly_it: Whether to fly it.
    """
    registry = Registry()
    missions = sorted((folder / "mission").glob("*.yaml"))
    environments: list[Path | None] = [*sorted((folder / "environment").glob("*.yaml")), None]
    around = [path for name in ("crazyflies.yaml", "config.yaml", "tags_36h11.yaml",
                                "server.yaml", "motion_capture.yaml")
              if (path := folder / name).exists()]  # fmt: skip
    for mission in missions:
        words = set(mission.read_text(encoding="utf-8").replace('"', " ").split())
        extra = [f"--agent={agent}" for agent in agents if agent.partition("=")[0] in words]
        for room in environments:
            for mode, flags in MODES.items():
                name = f"{folder.name}/{mission.stem}/{room.stem if room else '-'}/{mode}"
                files = [mission, *([room] if room else []), *around]
                status, error = _import([*map(str, files), *extra, *flags], out)
                if status:
                    yield Case(name, "refused", error, np.inf, 0, (0, 0))
                elif fly_it:
                    yield _fly(name, out / f"{mission.stem}.yaml", out / "run", registry)
                else:
                    yield Case(name, "imported", "", np.inf, 0, (0, 0))


def _import(arguments: Sequence[str], out: Path) -> tuple[int, str]:
    text = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(text):
        status = star(["import", *arguments, "--out", str(out), "--force"])
    return status, text.getvalue().replace("\n", " | ")[:300]


def _fly(name: str, path: Path, record: Path, registry: Registry) -> Case:
    with contextlib.redirect_stderr(io.StringIO()):
        mission = load(path, registry, OPTIONS)
        summary: dict[str, Any] = fly(mission, registry, folder=record)
    run = read_run(record, flown=True)
    steps = summary["steps"]
    return Case(
        name,
        summary["outcome"],
        json.dumps(summary["reason"]) if summary["reason"] else "",
        _nearest(run),
        int(summary["collisions"]["agent_agent"]),
        (sum(step["outcome"] != "aborted" for step in steps), len(steps)),
    )


def _nearest(run: Any) -> float:
    """Return the least distance of any drone in the flight to a solid obstacle, m."""
    position = run.arrays["truth_position"].reshape(-1, 3)
    nearest = np.inf
    for obstacle in run.world.obstacles:
        low, high = obstacle.height
        above = np.maximum(0.0, np.maximum(low - position[:, 2], position[:, 2] - high))
        for corners in obstacle.polygons:
            beside = shapely.distance(shapely.Polygon(corners), shapely.points(position[:, :2]))
            nearest = min(nearest, float(np.nanmin(np.hypot(beside, above))))
    return nearest


if __name__ == "__main__":
    sys.exit(main())
