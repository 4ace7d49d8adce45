"""Command line of ``star view``."""

from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from star_core import Mission, Registry, Run, fly, load, read_run
from star_core.commands import add_set_option
from star_core.toolkit import Progress
from star_view import require_viser
from star_view.avoidance import radius
from star_view.messages import PORT


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Serve the page until it is interrupted, and return the exit status, 0.

    Raises:
        InputError: There is neither a mission nor a record, or a package is missing.
    """
    require_viser("star view")
    from star_view.plan_scene import add_plan, planned_steps
    from star_view.replay import Replay

    path = Path(options.path)
    with Progress(f"preparing {path}"):
        plan = None
        if path.is_dir():
            run = read_run(path, flown=True)
        else:
            mission = load(path, registry, options.set)
            if mission.scene.realtime:  # the page shows a simulation of it
                mission = load(path, registry, [*options.set, "transport=sim"])
            plan = planned_steps(mission, registry)
            run = simulate(mission, registry)
        avoider = run.manifest["plugins"]["avoider"]
        kept_free = radius(avoider["name"], avoider["options"], registry)
        viewer = Replay(run, kept_free, port=options.port)
        if plan is not None:
            add_plan(viewer.server, run.swarm, plan)
    for number in (signal.SIGINT, signal.SIGTERM):  # a program that was started with & ignores both
        signal.signal(number, signal.default_int_handler)
    try:
        sys.stdout.write(f"{viewer.server.address} shows {path}; Ctrl-C ends it\n")
        sys.stdout.flush()
        viewer.serve()
    except KeyboardInterrupt:
        sys.stdout.write("\n")
    finally:
        viewer.server.close()
    return 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Show a flight in 3-D in the browser: a recorded one, or a simulation of a "
        "mission. The page is served on this machine only."
    )
    line.add_argument("path", help="mission file (YAML), or folder of a run")
    add_set_option(line)
    line.add_argument(
        "--port", type=int, default=PORT, help="port, or the next free one (%(default)s)"
    )


def simulate(mission: Mission, registry: Registry) -> Run:
    """Fly a mission in simulation and return its record, which is not kept."""
    with Progress(f"simulating {mission.name}", announced=True), TemporaryDirectory() as folder:
        fly(mission, registry, folder=Path(folder))
        return read_run(folder, flown=True)
