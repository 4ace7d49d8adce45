"""``star calibrate`` as its user sees it: reads pictures, writes a camera."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from star_calibrate.board import Board
from star_calibrate.lens import solve
from star_calibrate.report import as_lines, as_text, as_yaml
from star_calibrate.views import look
from star_core import InputError, read_as

NAME: Final = re.compile(r"(?!all$)[A-Za-z][A-Za-z0-9_-]*")  # as missions have it
USUAL: Final = "calibrated"  # where neither the user nor the file has a name for it
LARGEST: Final = 1.0  # m, of a square: more is meant in mm
SMALLEST: Final = 3  # inner corners each way: fewer make no pattern that OpenCV finds


def main(arguments: Sequence[str]) -> int:
    """Calibrate a camera and return the exit status, 0.

    Raises:
        InputError: The pictures or the flags will not do, or the file cannot be written.
    """
    options = parser().parse_args(arguments)
    board = _board(options.board, options.square)
    name = _name(options.name, options.out)
    if options.out is not None:
        _replaceable(Path(options.out))
    views = look(options.images, board)
    lens = solve(views, board)
    text, file = as_text(lens, views), as_yaml(lens, name)
    if options.out is None:
        sys.stderr.write(text)
        sys.stdout.write(file)
        return 0
    out = Path(options.out)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(file, encoding="utf-8")
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise InputError([f"--out {options.out}: cannot be written: {reason}"]) from error
    sys.stdout.write(f"{text}camera {name!r}: {out}\n{as_lines(name, out)}")
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line, apart so that the docs and the tests can read it."""
    star = argparse.ArgumentParser(
        prog="star calibrate",
        description="Find out what a camera's lens does.",
        allow_abbrev=False,
    )
    commands = star.add_subparsers(dest="what", required=True, metavar="WHAT")
    camera = commands.add_parser(
        "camera",
        help="focal lengths, principal point and distortion, by pictures of a chessboard",
        description="Calibrate a camera by pictures of a printed chessboard, and write it into a"
        " file that missions name.",
        epilog="Take 15 pictures or more, sharp, with the whole board in each: near and far, in"
        " every corner of the picture, tilted to all sides by up to 45 degrees.",
        allow_abbrev=False,
    )
    camera.add_argument("images", nargs="+", metavar="IMAGE", help="picture (PNG, JPEG, PGM, ...)")
    camera.add_argument(
        "--board",
        default="9x6",
        metavar="CxR",
        help="inner corners along its rows and columns, one less than squares (%(default)s)",
    )
    camera.add_argument(
        "--square", type=float, default=0.025, metavar="M", help="edge of a square, m (%(default)s)"
    )
    camera.add_argument(
        "--name", help=f"what missions shall call it (FILE without its ending, or {USUAL})"
    )
    camera.add_argument(
        "-o",
        "--out",
        metavar="FILE",
        help="write the camera to FILE, as cameras/mine.yaml, instead of printing it",
    )
    return star


def _name(given: str | None, out: str | None) -> str:
    """Return what missions shall call the camera: as given, or as its file is called.

    Raises:
        InputError: Missions have no such names.
    """
    if given is None:
        stem = "" if out is None else Path(out).stem
        return stem if NAME.fullmatch(stem) else USUAL
    if not NAME.fullmatch(given):
        raise InputError(
            [
                f"--name {given!r}: expected a letter, then letters, digits, '_' and '-',"
                " and not 'all'"
            ]
        )
    return given


def _replaceable(out: Path) -> None:
    """Refuse to write over a file that holds no camera.

    Raises:
        InputError: There is such a file.
    """
    if out.is_dir():
        raise InputError([f"--out {out}: cannot be written: Is a directory"])
    if not out.exists():
        return
    try:
        read_as(out, "camera")
    except InputError as error:
        raise InputError(
            [f"--out {out}: it is there already, and holds no camera: name another file"]
        ) from error


def _board(size: str, square: float) -> Board:
    """Return the board that the flags describe.

    Raises:
        InputError: They describe none.
    """
    found = re.fullmatch(r"(\d{1,3})x(\d{1,3})", size)
    if found is None or min(map(int, found.groups())) < SMALLEST:
        raise InputError(
            [f"--board {size!r}: expected inner corners as 9x6, at least {SMALLEST} each way"]
        )
    if not 0 < square <= LARGEST:
        wanted = f"the edge of a square in m, as 0.025, at most {LARGEST:g}"
        raise InputError([f"--square {square:g}: expected {wanted}"])
    return Board(int(found[1]), int(found[2]), square)
