"""``star import`` as its user sees it: reads files, tells what they were read as, writes ours."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from star_core import InputError
from star_import.assembly import Wishes, assemble
from star_import.notes import Notes
from star_import.sources import sorted_out
from star_import.tags import EDGE
from star_import.world_text import Room


def main(arguments: Sequence[str]) -> int:
    """Import files and return the exit status, 0.

    Raises:
        InputError: They cannot be imported; every reason found is listed.
    """
    options = parser().parse_args(arguments)
    notes = Notes()
    wishes = Wishes(
        name=options.name,
        agents=options.agent,
        fence=_fence(options.fence),
        edge=options.tag_size,
        corners=_corners(options),
        placed=_placed(options.target),
        speed=options.speed,
        timescale=options.timescale,
        as_executed=options.as_executed,
    )
    folder = Path(options.out)
    made = assemble(sorted_out([Path(file) for file in options.files]), wishes, notes)
    made.check(folder)
    files = made.write(folder, force=options.force)
    sys.stdout.write("".join(f"{line}\n" for line in notes.told))
    sys.stdout.write(f"written: {', '.join(map(str, files))}\n")
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line, apart so that the docs and the tests can read it."""
    star = argparse.ArgumentParser(
        prog="star import",
        description="Turn files of the original STAR (mission, environment) and of Crazyswarm2 "
        "(crazyflies.yaml, trajectories) into a mission and its world, and say what was assumed.",
        allow_abbrev=False,
    )
    star.add_argument("files", nargs="+", metavar="FILE", help="what to import, in any order")
    star.add_argument("--out", metavar="DIR", default="imported", help="write to DIR (%(default)s)")
    star.add_argument("--force", action="store_true", help="write over files that are there")
    star.add_argument("--name", help="of the mission (that of its file)")
    star.add_argument(
        "--agent",
        action="append",
        default=[],
        metavar="NAME=X,Y",
        help="an agent that no crazyflies.yaml places, m",
    )
    star.add_argument(
        "--target",
        action="append",
        default=[],
        metavar="TAG=X,Y",
        help="where a target lies whose place the environment does not know, m",
    )
    star.add_argument(
        "--fence",
        nargs=6,
        type=float,
        metavar=("X", "Y", "Z", "X2", "Y2", "Z2"),
        help="lowest and highest corner, m (around everything)",
    )
    star.add_argument(
        "--tag-size",
        type=_positive,
        default=EDGE,
        metavar="M",
        help="edge of the tags (%(default)s)",
    )
    star.add_argument(
        "--tag-origin",
        choices=["centre", "corner"],
        help="what the places of tags are of (centre; corner with --as-executed)",
    )
    star.add_argument("--speed", type=_positive, metavar="M/S", help="of flights (0.1; 0.5)")
    star.add_argument(
        "--timescale", type=_positive, default=1.0, metavar="TIMES", help="of trajectories"
    )
    star.add_argument(
        "--as-executed",
        action="store_true",
        help="keep what the original did where it meant something else",
    )
    return star


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


def _placed(texts: Sequence[str]) -> dict[int, tuple[float, float]]:
    found = {}
    for text in texts:
        number, _, place = text.partition("=")
        try:
            x, y = (float(value) for value in place.split(","))
            found[int(number)] = (x, y)
        except ValueError:
            raise InputError([f"--target {text}: expected TAG=X,Y in m"]) from None
    return found
