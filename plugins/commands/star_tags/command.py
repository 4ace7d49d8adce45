"""Command line of ``star tags``: reads a world, and writes its tags."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from star_core import InputError, Registry
from star_core.commands import writing
from star_core.toolkit import PAPERS, Page, Progress, pdf, svg
from star_tags.plan import plan_pages
from star_tags.world import pages


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Write the tags of a world and return the exit status, 0.

    Raises:
        InputError: They cannot be printed, or the file cannot be written.
    """
    world = Path(options.world)
    out = Path(options.out or f"{world.stem}-{'plan' if options.plan else 'tags'}.pdf")
    if out.suffix not in {".pdf", ".svg"}:
        raise InputError(
            f"--out {out}: expected a name that ends in .pdf or .svg", "invalid-argument"
        )
    with writing(f"--out {out}"), Progress("drawing the tags"):
        if options.plan:
            numbered_pages = list(enumerate(plan_pages(world, options.paper, registry), start=1))
        else:
            numbered_pages = pages(world, options.paper, registry)
        files = _write(numbered_pages, out)
    what = "pages" if options.plan else "tags"
    sys.stdout.write(
        f"{len(numbered_pages)} {what} on {options.paper}: {', '.join(map(str, files))}\n"
    )
    return 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Write the tags of a world as sheets to print in true size, one per page; or a plan."
    )
    line.add_argument("world", help="world file (YAML)")
    line.add_argument(
        "-o",
        "--out",
        metavar="FILE",
        help="FILE.pdf, or FILE.svg for one file per tag or page: FILE-NUMBER.svg (WORLD-tags.pdf)",
    )
    line.add_argument(
        "--plan",
        action="store_true",
        help="write a plan of the floor with the tags, and a table of distances to lay them out"
        " (WORLD-plan.pdf)",
    )
    line.add_argument("--paper", choices=list(PAPERS), default="a4", help="%(default)s")


def _write(numbered_pages: Sequence[tuple[int, Page]], out: Path) -> list[Path]:
    """Write pages and return the files.

    Raises:
        OSError: A file cannot be written.
    """
    if out.suffix == ".pdf":
        out.write_bytes(pdf([page for _, page in numbered_pages]))
        return [out]
    files = [out.with_name(f"{out.stem}-{number}.svg") for number, _ in numbered_pages]
    for file, (_, page) in zip(files, numbered_pages, strict=True):
        file.write_text(svg(page), encoding="utf-8")
    return files
