"""Command line of ``star calibrate``: reads images, writes a camera."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Final

from star_calibrate.board import Board, Views, find_views
from star_calibrate.lens import Lens, solve
from star_calibrate.printed_board import board_page
from star_core import InputError, Registry
from star_core.commands import writing
from star_core.formats import read_as
from star_core.toolkit import PAPERS, Progress, pdf, svg

NAME: Final = re.compile(r"(?!all$)[A-Za-z][A-Za-z0-9_-]*")  # as in missions
DEFAULT_NAME: Final = "calibrated"
PIXELS: Final = ("gray", "bayer_rggb", "bayer_bggr", "bayer_grbg", "bayer_gbrg")
MAX_SQUARE: Final = 1.0  # m: a larger one is probably in mm
MIN_CORNERS: Final = 3  # inner corners each way, for OpenCV to find the pattern
MIN_COVERAGE: Final = 0.75  # of the image's cells: with less its edges are uncertain


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Calibrate a camera, or write a board, and return the exit status, 0.

    Raises:
        InputError: The images or the arguments cannot be used, or the file cannot be written.
    """
    board = _board(options.board, options.square)
    if options.what == "board":
        return _print(board, options.paper, Path(options.out))
    name = _name(options.name, options.out)
    if options.out is not None:
        _check_replaceable(Path(options.out), registry)
    views = find_views(options.images, board, options.pixels)
    with Progress("calibrating"):
        lens = solve(views, board)
    text, file = as_text(lens, views), as_yaml(lens, name, options.pixels)
    if options.out is None:
        sys.stderr.write(text)
        sys.stdout.write(file)
        return 0
    out = Path(options.out)
    with writing(f"--out {out}"):
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(file, encoding="utf-8")
    sys.stdout.write(f"{text}camera {name!r}: {out}\n{as_lines(name, out)}")
    return 0


def _print(board: Board, paper: str, out: Path) -> int:
    """Write a board to print, and return the exit status, 0."""
    if out.suffix not in {".pdf", ".svg"}:
        expected = "expected a name that ends in .pdf or .svg"
        raise InputError(f"--out {out}: {expected}", "invalid-argument")
    page = board_page(board, paper)
    with writing(f"--out {out}"):
        out.write_bytes(pdf([page]) if out.suffix == ".pdf" else svg(page).encode())
    sys.stdout.write(f"a board of {board.columns}x{board.rows} inner corners on {paper}: {out}\n")
    return 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    commands = line.add_subparsers(dest="what", required=True, metavar="WHAT")
    camera = commands.add_parser(
        "camera",
        help="focal lengths, principal point and distortion, by images of a chessboard",
        description="Calibrate a camera by images of a printed chessboard, and write it to a file"
        " for missions.",
        epilog="Take 15 images or more, sharp, with the whole board in each: near and far, in"
        " every corner of the image, tilted to all sides by up to 45 degrees.",
        allow_abbrev=False,
    )
    camera.add_argument("images", nargs="+", metavar="IMAGE", help="image (PNG, JPEG, PGM, ...)")
    _add_board(camera)
    camera.add_argument(
        "--pixels",
        choices=PIXELS,
        default="gray",
        help="what the images are: gray, or raw mosaics of a color sensor by the colors of their"
        " first two pixels and of those below them (%(default)s)",
    )
    camera.add_argument(
        "--name",
        help=f"name of the camera in missions (FILE without its ending, or {DEFAULT_NAME})",
    )
    camera.add_argument(
        "-o",
        "--out",
        metavar="FILE",
        help="write the camera to FILE, such as cameras/mine.yaml, instead of printing it",
    )
    printed = commands.add_parser(
        "board",
        help="a chessboard to print in true size",
        description="Write a chessboard to print, for the calibration of a camera.",
        allow_abbrev=False,
    )
    _add_board(printed)
    printed.add_argument("--paper", choices=list(PAPERS), default="a4", help="%(default)s")
    printed.add_argument(
        "-o",
        "--out",
        metavar="FILE",
        default="board.pdf",
        help="FILE.pdf or FILE.svg (%(default)s)",
    )


def _add_board(line: argparse.ArgumentParser) -> None:
    """Add the options that describe a board."""
    line.add_argument(
        "--board",
        default="9x6",
        metavar="CxR",
        help="inner corners along its rows and columns, one less than squares (%(default)s)",
    )
    line.add_argument(
        "--square", type=float, default=0.025, metavar="M", help="edge of a square, m (%(default)s)"
    )


def as_text(lens: Lens, views: Views) -> str:
    """Return a report on the quality of a lens, several lines."""
    used = {fit.name: f"{fit.error:.3f} px at {fit.distance:.2f} m" for fit in lens.used}
    rejected = {fit.name: f"rejected: {fit.error:.3f} px" for fit in lens.rejected}
    values = zip(("fx", "fy", "cx", "cy"), lens.matrix, lens.deviation, strict=True)
    lines = [
        *(f"{view.name}: {(used | rejected)[view.name]}" for view in views.with_board),
        *(f"{name}: no board" for name in views.without),
        f"RMS {lens.error:.3f} px over {len(lens.used)} images",
        *(f"{name} {value:.2f} +- {deviation:.2f} px" for name, value, deviation in values),
        f"corners in {lens.covered:.0%} of the image",
    ]
    if lens.covered < MIN_COVERAGE:
        lines.append("the lens is not known where no corner was: add images with the board there")
    return "\n".join(lines) + "\n"


def as_yaml(lens: Lens, name: str, pixels: str) -> str:
    """Return the file of a camera, for missions."""
    matrix = ", ".join(f"{value:.2f}" for value in lens.matrix)
    distortion = ", ".join(f"{value:.5f}" for value in lens.distortion)
    return (
        f"# A camera, calibrated by {len(lens.used)} images of a chessboard: {lens.error:.3f} px"
        " RMS.\n"
        "# Its position, pitch_deg and rate are an AI-deck's unless they are given, here or in a"
        " mission.\n"
        "star: 1\n"
        f'name: "{name}"\n'
        f"width: {lens.width}\n"
        f"height: {lens.height}\n"
        f"matrix: [{matrix}]\n"
        f"distortion: [{distortion}]\n" + ("" if pixels == "gray" else f"pixels: {pixels}\n")
    )


def as_lines(name: str, out: Path) -> str:
    """Return the two lines by which a mission uses the camera in a file.

    The mission is beside it, or beside the folder ``cameras`` that it is in.

    >>> print(as_lines("mine", Path("missions/cameras/mine.yaml")), end="")
    to use it, add these two lines to a mission in 'missions':
      cameras: {mine: {file: cameras/mine.yaml}}
      swarm: {cf1: {camera: mine, ...}}
    """
    folder = out.parent.parent if out.parent.name == "cameras" else out.parent
    return (
        f"to use it, add these two lines to a mission in {str(folder)!r}:\n"
        f"  cameras: {{{name}: {{file: {out.relative_to(folder).as_posix()}}}}}\n"
        f"  swarm: {{cf1: {{camera: {name}, ...}}}}\n"
    )


def _name(name: str | None, out: str | None) -> str:
    """Return the camera's name in missions: that of the option, or of its file."""
    if name is None:
        stem = "" if out is None else Path(out).stem
        return stem if NAME.fullmatch(stem) else DEFAULT_NAME
    if not NAME.fullmatch(name):
        expected = "a letter, then letters, digits, '_' and '-', and not 'all'"
        raise InputError(f"--name {name!r}: expected {expected}", "invalid-argument")
    return name


def _check_replaceable(out: Path, registry: Registry) -> None:
    """Refuse to overwrite a file that is not a camera."""
    if out.is_dir():
        raise InputError(f"--out {out}: cannot be written: Is a directory", "unwritable-file")
    if not out.exists():
        return
    try:
        read_as(out, "camera", registry)
    except InputError as error:
        reason = f"--out {out}: it exists and is not a camera; name another file"
        raise InputError(reason, "unwritable-file") from error


def _board(size: str, square: float) -> Board:
    """Return the board that the arguments describe."""
    match = re.fullmatch(r"(\d{1,3})x(\d{1,3})", size)
    if match is None or min(map(int, match.groups())) < MIN_CORNERS:
        expected = f"inner corners as 9x6, at least {MIN_CORNERS} each way"
        raise InputError(f"--board {size!r}: expected {expected}", "invalid-argument")
    if not 0 < square <= MAX_SQUARE:
        expected = f"the edge of a square in m, as 0.025, at most {MAX_SQUARE:g}"
        raise InputError(f"--square {square:g}: expected {expected}", "invalid-argument")
    return Board(int(match[1]), int(match[2]), square)
