"""``star missions``: lists the missions that come with STAR."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from itertools import groupby

from star_basics.columns import columns
from star_core import Registry
from star_core.formats import format_function


def configure(_line: ArgumentParser) -> None:
    """Add no options."""


def run(_options: Namespace, registry: Registry) -> int:
    """Print names and descriptions, by folder, and return the exit status, 0."""
    files = format_function("missions", registry)()
    for folder, names in groupby(files, key=lambda name: name.rpartition("/")[0]):
        rows = ((name, files[name][1]) for name in names)
        print(folder or "missions", *columns(rows), "", sep="\n")
    print(f"`star run NAME` flies one. To copy: {files['first_flight'][0].parent}")
    return 0
