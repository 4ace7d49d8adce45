"""``star missions``: lists the missions that come with STAR."""

from __future__ import annotations

from argparse import Namespace
from itertools import groupby

from star_basics.columns import columns
from star_core import Registry
from star_core.commands import file_description, shipped_files


def run(_options: Namespace, _registry: Registry) -> int:
    """Print names and descriptions, by folder, and return the exit status, 0."""
    files = shipped_files()
    for folder, names in groupby(files, key=lambda name: name.rpartition("/")[0]):
        rows = ((name, file_description(files[name])) for name in names)
        print(folder or "missions", *columns(rows), "", sep="\n")
    print(f"`star run NAME` flies one. To copy: {files['first_flight'].parent}")
    return 0
