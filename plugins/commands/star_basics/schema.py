"""``star schema``: writes a JSON Schema of a kind of file, for editors."""

from __future__ import annotations

import json
from argparse import ArgumentParser, Namespace
from pathlib import Path

from star_core import Registry
from star_core.commands import writing
from star_core.formats import format_function


def configure(registry: Registry, line: ArgumentParser) -> None:
    """Add the options of the command."""
    kinds = registry.offers()["file_kind"].values()
    line.add_argument(
        "of",
        nargs="?",
        default="mission",
        choices=[kind.name for kind in kinds if kind.schema is not None],
        help="kind of file: mission",
    )
    line.add_argument("--out", metavar="FILE", help="write to FILE instead of printing")


def run(options: Namespace, registry: Registry) -> int:
    """Print or write the schema and return the exit status, 0.

    Raises:
        InputError: The file cannot be written.
    """
    text = json.dumps(format_function("schema", registry)(options.of, registry), indent=2)
    if options.out:
        with writing(options.out):
            Path(options.out).write_text(text + "\n", encoding="utf-8")
    else:
        print(text)
    return 0
