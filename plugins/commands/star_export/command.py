"""Command line of ``star export``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from star_core import InputError, read_run
from star_core.commands import replace_file, writing
from star_core.toolkit import Progress
from star_export.tables import csv_files, tum_files

FORMATS: Final = {"csv": csv_files, "tum": tum_files}


def main(arguments: Sequence[str]) -> int:
    """Write the files, print their names and return the exit status, 0.

    Raises:
        InputError: The folder holds no complete record, or a file cannot be written.
    """
    options = parser().parse_args(arguments)
    files = []
    with Progress(f"exporting {options.run}"):
        run = read_run(options.run)
        out = Path(options.out) if options.out else run.folder / options.format
        if not options.out and out.is_symlink():  # the folder may be of others
            raise InputError(f"{out}: is a link; name a folder by --out", "unwritable-file")
        for name, text in FORMATS[options.format](run):
            files.append(out / name)
            with writing(files[-1]):
                out.mkdir(parents=True, exist_ok=True)
                replace_file(files[-1], text)
    sys.stdout.writelines(f"{file}\n" for file in files)
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the command-line parser; separate so that docs and tests can read it."""
    star = argparse.ArgumentParser(
        prog="star export",
        description="Write a recorded flight in another format, with files for each agent. csv: "
        "all arrays, one line per tick. tum: estimated and true trajectory (time x y z qx qy qz "
        "qw), for evo and other tools.",
        allow_abbrev=False,
    )
    star.add_argument("run", help="folder of a run: runs/TIME-NAME")
    star.add_argument("--format", choices=list(FORMATS), required=True, help="format of the files")
    star.add_argument("-o", "--out", metavar="DIR", help="folder to write to (RUN/FORMAT)")
    return star
