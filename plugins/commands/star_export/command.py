"""Command line of ``star export``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final

from star_core import InputError, Registry, read_run
from star_core.commands import replace_file, writing
from star_core.toolkit import Progress
from star_export.tables import csv_files, tum_files

FORMATS: Final = {"csv": csv_files, "tum": tum_files}


def run(options: argparse.Namespace, _registry: Registry) -> int:
    """Write the files, print their names and return the exit status, 0.

    Raises:
        InputError: The folder holds no complete record, or a file cannot be written.
    """
    files = []
    with Progress(f"exporting {options.run}"):
        run = read_run(options.run, flown=True)
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


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Write a recorded flight in another format, with files for each agent. csv: "
        "all arrays, one line per tick. tum: estimated and true trajectory (time x y z qx qy qz "
        "qw), for evo and other tools."
    )
    line.add_argument("run", help="folder of a run: runs/TIME-NAME")
    line.add_argument("--format", choices=list(FORMATS), required=True, help="format of the files")
    line.add_argument("-o", "--out", metavar="DIR", help="folder to write to (RUN/FORMAT)")
