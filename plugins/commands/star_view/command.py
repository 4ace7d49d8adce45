"""Command line of ``star view``."""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias, cast

from star_core import InputError, Mission, Registry, Run, StarError, World, fly, load, read_run
from star_core.commands import add_set_option, completes, mission_names
from star_core.formats import format_function, read_as, recognized_as
from star_core.toolkit import Progress, log
from star_view import require_viser
from star_view.avoidance import radius
from star_view.messages import PORT

if TYPE_CHECKING:
    from star_view.page import Page
    from star_view.plan_scene import PlannedStep

PERIOD: Final = 0.5  # s, between looks at the files

Served: TypeAlias = "tuple[Page, Callable[[Callable[[], bool]], None]]"
"""A page and its loop, which takes a function that returns whether the loop is to end."""


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Serve the page until it is interrupted, and return the exit status, 0.

    The page of a mission or a world is replaced when one of its files is saved.

    Raises:
        InputError: There is neither a mission, a world nor a record, or a package is missing.
    """
    require_viser("star view")
    path = Path(options.path)
    shown = _shown(path, options.set, registry)
    for number in (signal.SIGINT, signal.SIGTERM):  # a program that was started with & ignores both
        signal.signal(number, signal.default_int_handler)
    port, token, address = options.port, None, ""
    while True:
        page, serve = shown.open(port, token)
        try:
            port, token = page.get_port(), page.gate.token
            if page.address != address:
                address = page.address
                sys.stdout.write(f"{address} shows {path}; Ctrl-C ends it\n")
                sys.stdout.flush()
            watch = FileWatch(shown.files)
            serve(watch.changed)
            while (again := _again(path, options.set, registry)) is None:
                serve(watch.changed)
            shown = again
        except KeyboardInterrupt:
            sys.stdout.write("\n")
            return 0
        finally:
            page.close()


class Shown(NamedTuple):
    """What a page shows.

    Attributes:
        files: Files that it is made of; it is made again when one is saved.
        open: ``open(port, token)`` serves a page.
    """

    files: Sequence[Path]
    open: Callable[[int, str | None], Served]


def _again(path: Path, assignments: Sequence[str], registry: Registry) -> Shown | None:
    """Return what a saved file is to show; None after reporting its problems."""
    log(f"star: {path} was saved")
    try:
        return _shown(path, assignments, registry)
    except StarError as error:
        log(str(error))
        return None


def _shown(path: Path, assignments: Sequence[str], registry: Registry) -> Shown:
    """Return what the page of a record, a mission or a world shows.

    Raises:
        InputError: It is none of them, or has a problem.
    """
    from star_view.plan_scene import planned_steps

    with Progress(f"preparing {path}"):
        if path.is_dir() and recognized_as(path, registry) is None:
            return _replayed(read_run(path, flown=True), (), registry)
        try:
            mission = load(path, registry, assignments)
        except InputError as error:
            if error.code != "wrong-file" or (world := _world(path, registry)) is None:
                raise
            return Shown([path], partial(_open_world, world))
        if mission.scene.realtime:  # the page shows a simulation of it
            mission = load(path, registry, [*assignments, "transport=sim"])
        files = [mission.file.path, mission.world_file.path, *mission.scene.files.values()]
        plan = planned_steps(mission, registry)
        return _replayed(simulate(mission, registry), files, registry, plan)


def _replayed(
    run: Run, files: Sequence[Path], registry: Registry, plan: Sequence[PlannedStep] | None = None
) -> Shown:
    """Return a page that replays a flight."""
    from star_view.plan_scene import add_plan
    from star_view.replay import Replay

    avoider = run.manifest["plugins"]["avoider"]
    kept_free = radius(avoider["name"], avoider["options"], registry)

    def open_replay(port: int, token: str | None) -> Served:
        viewer = Replay(run, kept_free, port=port, token=token)
        if plan is not None:
            add_plan(viewer.server, run.swarm, plan)
        return viewer.server, viewer.serve

    return Shown(files, open_replay)


def _world(path: Path, registry: Registry) -> World | None:
    """Return the world of a file; None if it is no world."""
    try:
        data = read_as(path, "world", registry).data
    except InputError as error:
        if error.code == "wrong-file":
            return None
        raise
    _agents, world = format_function("restore", registry)(
        {"mission": {"swarm": {}}, "world": data}, path
    )
    return cast("World", world)


def _open_world(world: World, port: int, token: str | None) -> Served:
    """Serve a page with a world alone."""
    from star_view.page import add_dark_switch, open_page

    def serve(ended: Callable[[], bool]) -> None:
        while not ended():
            time.sleep(PERIOD)

    page = open_page(world, port, world.name, token)
    named = {
        "obstacle": world.obstacles,
        "tag": world.landmarks,
        "target": world.targets,
        "base station": world.base_stations,
        "anchor": world.anchors,
    }
    counts = [f"{len(of)} {noun}{'s' * (len(of) > 1)}" for noun, of in named.items() if of]
    page.gui.add_markdown(", ".join(counts) or "an empty room")
    add_dark_switch(page)
    return page, serve


class FileWatch:
    """Notices when one of some files is saved.

    Args:
        files: To watch.
    """

    def __init__(self, files: Sequence[Path]) -> None:
        self._files = files
        self._last_times = self._times()
        self._due = 0.0  # s, of the next look

    def changed(self) -> bool:
        """Return whether a file was saved since the last call that returned True."""
        now = time.monotonic()
        if now < self._due:
            return False
        self._due = now + PERIOD
        times = self._times()
        if times == self._last_times or None in times:  # while it is replaced it is missing
            return False
        self._last_times = times
        return True

    def _times(self) -> list[int | None]:
        return [file.stat().st_mtime_ns if file.exists() else None for file in self._files]


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Show a flight in 3-D in the browser: a recorded one, or a simulation of a "
        "mission; or a world. Saved files are shown again. The page is served on this machine only."
    )
    path = line.add_argument("path", help="mission or world file (YAML), or folder of a run")
    completes(path, mission_names)
    add_set_option(line)
    line.add_argument(
        "--port", type=int, default=PORT, help="port, or the next free one (%(default)s)"
    )


def simulate(mission: Mission, registry: Registry) -> Run:
    """Fly a mission in simulation and return its record, which is not kept."""
    with Progress(f"simulating {mission.name}", announced=True), TemporaryDirectory() as folder:
        fly(mission, registry, folder=Path(folder))
        return read_run(folder, flown=True)
