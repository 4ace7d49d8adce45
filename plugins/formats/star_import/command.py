"""Command line of ``star import``: reads files, logs assumptions, and writes STAR's files."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from star_core import InputError, Registry
from star_import.assembly import ImportOptions, assemble
from star_import.import_log import ImportLog
from star_import.output_files import Room
from star_import.sources import sorted_out
from star_import.tags import EDGE


def run(flags: argparse.Namespace, registry: Registry) -> int:
    """Import files and return the exit status, 0.

    Raises:
        InputError: They cannot be imported; lists every reason.
    """
    log = ImportLog()
    options = ImportOptions(
        name=flags.name,
        agents=flags.agent,
        fence=_fence(flags.fence),
        edge=flags.tag_size,
        corners=_corners(flags),
        target_positions=_target_positions(flags.target),
        speed=flags.speed,
        timescale=flags.timescale,
        as_executed=flags.as_executed,
    )
    folder = Path(flags.out)
    sources = sorted_out([Path(file) for file in flags.files], registry)
    output = assemble(sources, options, log)
    output.check(folder)
    files = output.write(folder, force=flags.force)
    sys.stdout.write("".join(f"{line}\n" for line in log.messages))
    sys.stdout.write(f"written: {', '.join(map(str, files))}\n")
    return 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Convert files of the original STAR (mission, environment) and of Crazyswarm2 "
        "(crazyflies.yaml, trajectories) to a mission and its world, and list all assumptions."
    )
    line.add_argument("files", nargs="+", metavar="FILE", help="files to import, in any order")
    line.add_argument("--out", metavar="DIR", default="imported", help="write to DIR (%(default)s)")
    line.add_argument("--force", action="store_true", help="overwrite existing files")
    line.add_argument("--name", help="name of the mission (that of its file)")
    line.add_argument(
        "--agent",
        action="append",
        default=[],
        metavar="NAME=X,Y",
        help="add an agent that no crazyflies.yaml lists; position in m",
    )
    line.add_argument(
        "--target",
        action="append",
        default=[],
        metavar="TAG=X,Y",
        help="position of a target that has none in the environment, m",
    )
    line.add_argument(
        "--fence",
        nargs=6,
        type=float,
        metavar=("X", "Y", "Z", "X2", "Y2", "Z2"),
        help="lower and upper corner of the fence, m (around everything)",
    )
    line.add_argument(
        "--tag-size",
        type=_positive,
        metavar="M",
        help=f"edge of the tags, m ({EDGE:g})",
    )
    line.add_argument(
        "--tag-origin",
        choices=["centre", "corner"],
        help="reference point of tag positions (centre; corner with --as-executed)",
    )
    line.add_argument("--speed", type=_positive, metavar="M/S", help="flight speed (0.1; 0.5)")
    line.add_argument(
        "--timescale",
        type=_positive,
        default=1.0,
        metavar="TIMES",
        help="factor by which trajectories are stretched",
    )
    line.add_argument(
        "--as-executed",
        action="store_true",
        help="reproduce what the original did where that differs from the intent",
    )


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r}, expected a number more than 0")
    return value


def _corners(options: argparse.Namespace) -> bool:
    if options.tag_origin is None:
        return bool(options.as_executed)
    return bool(options.tag_origin == "corner")


def _fence(numbers: Sequence[float] | None) -> Room | None:
    if numbers is None:
        return None
    ax, ay, az, bx, by, bz = numbers
    return Room((ax, ay, az), (bx, by, bz))


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
