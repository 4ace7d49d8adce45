"""Command line of ``star import``: reads files, reports what became of them, and writes STAR's."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from star_core import InputError, Registry, load
from star_core.toolkit import suggestion, terminal_width
from star_import.assembly import FENCE, ImportOptions, assemble, log_fence
from star_import.import_log import ImportLog, as_json, table
from star_import.output_files import OutputFiles, Room, around_all, write
from star_import.selection import Choice, selected
from star_import.sources import Sources
from star_import.tags import EDGE
from star_import.trajectories import Trajectories


def run(flags: argparse.Namespace, registry: Registry) -> int:
    """Import files; return 0, or 2 if some of several missions cannot be imported.

    Raises:
        InputError: No mission can be imported; lists every reason.
    """
    options = ImportOptions(
        name=flags.name,
        agents=flags.agent,
        fence=_fence(flags.fence),
        edge=flags.tag_size,
        corners=None if flags.tag_origin is None else flags.tag_origin == "corner",
        target_positions=_target_positions(flags.target),
        virtual=flags.virtual,
        solid=flags.solid,
        speed=flags.speed,
        acceleration=flags.acceleration,
        trajectories=Trajectories(
            timescale=flags.timescale,
            bridge=flags.bridge_gaps,
            on_board=flags.on_board,
            assigned=dict(_assigned(flags.trajectory)),
            speed=flags.speed,
        ),
        as_executed=flags.as_executed,
    )
    folder = Path(flags.out)
    choice = Choice(flags.environment or "", "--environment ")
    missions = [*selected([Path(file) for file in flags.files], choice, registry)]
    if len(missions) > 1 and flags.name:
        raise InputError("--name: there are several missions, which keep theirs", "option-conflict")
    log = ImportLog()
    outputs = [*_imported(missions, options, folder, log, registry)]
    files = write(outputs, folder, force=flags.force)
    refused = len(missions) - len(outputs)
    if flags.json:
        sys.stdout.write(as_json(log.notes, map(str, files)))
    else:
        sys.stdout.write(table(log.notes, terminal_width()))
        sys.stdout.write(f"written: {', '.join(map(str, files))}\n")
        if refused:
            sys.stdout.write(f"{refused} of {len(missions)} missions cannot be imported\n")
    return 2 if refused else 0


def _imported(
    missions: Sequence[Sources],
    options: ImportOptions,
    folder: Path,
    log: ImportLog,
    registry: Registry,
) -> Iterator[OutputFiles]:
    """Yield the files of every mission that can be imported.

    They have one world: an obstacle is virtual in all or none, and the fence is around all.

    Raises:
        InputError: None can be; lists every reason.
    """
    good, problems = dict[str | None, Sources](), list[str]()
    rooms = list[Room]()
    virtual, obstacles = set(options.virtual), set[str]()
    for sources in missions:
        own = ImportLog()
        try:
            output = assemble(sources, options, own, registry)
            _require_new(output.mission, good, sources)
            with output.staged(folder) as staged:
                load(staged, registry)
        except InputError as error:
            problems += error.problems
            log.refuse(error)
            continue
        good[output.mission] = sources
        rooms.append(output.room)
        virtual |= output.virtual
        obstacles |= {wall.name for wall in output.walls}
        log.notes += own.notes
    if not good:
        raise InputError(list(dict.fromkeys(problems)))
    for flag, names in (("--virtual", options.virtual), ("--solid", options.solid)):
        for name in sorted({*names} - obstacles - {"all"}):
            listed = suggestion(name, sorted(obstacles), "obstacles")
            text = f"{flag} {name}: no obstacle has this name{listed}"
            raise InputError(text, "unknown-obstacle")
    fence = around_all(rooms)
    notes = [note for note in log.notes if note.location != FENCE]
    if len(notes) < len(log.notes):
        log.notes = notes
        log_fence(fence, log)
    for sources in good.values():
        every = replace(options, virtual=virtual, fence=fence)
        yield assemble(sources, every, ImportLog(), registry)


def _require_new(name: str | None, others: Collection[str | None], sources: Sources) -> None:
    """Raise `InputError` if another mission is written to the file of a name."""
    if name in others:
        text = f"another mission is written to {name} too; rename one"
        raise InputError(f"{sources.paths[0]}: {text}", "duplicate-name")


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Convert files of the original STAR (its launch folder, or any of its files), of "
        "Crazyswarm2 (crazyflies.yaml, motion_capture.yaml, trajectories) and of Crazyswarm "
        "(allCrazyflies.yaml, crazyflieTypes.yaml) to missions and their worlds, and base stations "
        "and anchors that the Crazyflie client saved to worlds; list what was refused, changed, "
        "assumed and ignored."
    )
    add = line.add_argument
    several = partial(add, action="append", default=[])
    switch = partial(add, action="store_true")
    size = partial(add, type=_positive)
    add("files", nargs="+", metavar="FILE", help="files and folders to import, in any order")
    add("--out", metavar="DIR", default="imported", help="write to DIR (%(default)s)")
    switch("--force", help="overwrite existing files")
    switch("--json", help="print the list as JSON")
    add("--name", help="name of the mission (that of its file)")
    add("--environment", metavar="NAME", help="environment to fly in (that of config.yaml)")
    text = "add an agent that no crazyflies.yaml lists; position in m"
    several("--agent", metavar="NAME=X,Y", help=text)
    text = "position of a target that has none in the environment, m"
    several("--target", metavar="TAG=X,Y", help=text)
    text = "obstacle that agents may fly through, or `all` (those that hold tags, starts or goals)"
    several("--virtual", metavar="NAME", help=text)
    text = "obstacle that is really there, or `all`: not virtual in any case"
    several("--solid", metavar="NAME", help=text)
    corners = ("X", "Y", "Z", "X2", "Y2", "Z2")
    text = "lower and upper corner of the fence, m (around everything)"
    add("--fence", nargs=6, type=float, metavar=corners, help=text)
    size("--tag-size", metavar="M", help=f"edge of the tags, m ({EDGE:g})")
    text = "reference point of tag positions (centre; with --as-executed that of config.yaml)"
    add("--tag-origin", choices=["centre", "corner"], help=text)
    size("--speed", metavar="M/S", help="speed limit (0.1; 0.5)")
    size("--acceleration", metavar="M/S2", help="acceleration limit (2)")
    text = "factor by which trajectories are stretched"
    size("--timescale", default=1.0, metavar="TIMES", help=text)
    text = "trajectory of one agent; those of several are flown at once"
    several("--trajectory", metavar="NAME=FILE", help=text)
    switch("--bridge-gaps", help="bridge gaps between pieces of trajectories by further pieces")
    switch("--on-board", help="let the drones' commanders fly trajectories")
    text = "reproduce what the original did where that differs from the intent"
    switch("--as-executed", help=text)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r}, expected a number more than 0")
    return value


def _fence(numbers: Sequence[float] | None) -> Room | None:
    if numbers is None:
        return None
    ax, ay, az, bx, by, bz = numbers
    return Room((ax, ay, az), (bx, by, bz))


def _assigned(texts: Sequence[str]) -> Iterator[tuple[str, Path]]:
    for text in texts:
        name, _, file = text.partition("=")
        if not name or not file:
            raise InputError(f"--trajectory {text}: expected NAME=FILE", "invalid-input")
        if not Path(file).is_file():
            raise InputError(f"--trajectory {text}: no such file", "file-not-found")
        yield name, Path(file)


def _target_positions(texts: Sequence[str]) -> dict[int, tuple[float, float]]:
    positions = {}
    for text in texts:
        number, _, position = text.partition("=")
        try:
            x, y = (float(value) for value in position.split(","))
            positions[int(number)] = (x, y)
        except ValueError:
            raise InputError([f"--target {text}: expected TAG=X,Y in m"]) from None
    return positions
