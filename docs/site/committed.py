"""Rewrites the parts of pages in ``docs/`` that are made from the code: run it after a change.

Examples of plugins are the files that ``star new plugin`` writes, named by a comment in the page.
``docs/plugins/tables.md`` has the fields of the tables that plugins receive, from their docstrings;
``docs/pictures/tick.svg`` is drawn by `tick_diagram`.

    python docs/site/committed.py
"""

from __future__ import annotations

import contextlib
import inspect
import os
import re
import tempfile
from collections.abc import Iterator
from dataclasses import fields
from enum import Enum
from io import StringIO
from pathlib import Path
from typing import Any, Final

from tick_diagram import diagram

import star_core
from star_core.commands.main import main

DOCS: Final = Path(__file__).parents[1]
PAGES: Final = (DOCS.parent / "README.md", *sorted((DOCS / "plugins").glob("*.md")))
PICTURE: Final = DOCS / "pictures" / "tick.svg"
TABLES: Final = DOCS / "plugins" / "tables.md"
COMMAND: Final = re.compile(r"^<!-- star (new plugin (\S+) --kind \S+) -->$", re.MULTILINE)
FILE: Final = re.compile(r"^(`([\w./-]+)`:\n\n```\w+\n)(.*?)(?=^```$)", re.MULTILINE | re.DOTALL)

GROUPS: Final = {
    "Before the flight": ("Scene", "Agent", "Limits", "World", "Fence", "Obstacle", "Tag"),
    "In every tick": ("Telemetry", "Odometry", "Supervisor", "Estimate", "Transform", "Health",
                      "AgentPhase", "Goals", "Plan", "Paths", "Setpoint"),
    "Vision and positioning": ("Frames", "Detections", "PoseFixes", "Sightings", "Corrections"),
    "Tasks and commands": ("TaskOutput", "Status", "Command", "Order", "Trajectory"),
    "Observers": ("Flight", "Tick", "Corrected", "Event", "Truth"),
}  # fmt: skip


def with_examples(page: str) -> str:
    """Return a page with its examples as ``star new plugin`` writes them."""
    command = COMMAND.search(page)
    if command is None:
        return page
    files = _written(command[1].split(), command[2])

    def replaced(found: re.Match[str]) -> str:
        return found[1] + files.get(found[2], found[3])

    return page[: command.end()] + FILE.sub(replaced, page[command.end() :])


def _written(arguments: list[str], name: str) -> dict[str, str]:
    """Return the files that ``star new`` writes, by their path in the plugin's folder."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(StringIO()):
        os.chdir(folder)
        try:
            main(arguments)
            root = Path(f"star-{name}")
            return {
                str(path.relative_to(root)): path.read_text("utf-8")
                for path in root.rglob("*")
                if path.is_file()
            }
        finally:
            os.chdir(here)


def tables() -> str:
    """Return the page of the tables that plugins receive and return."""
    lines = [
        "# What plugins receive", "",
        "Generated from the code by `python docs/site/committed.py`. Import these from `star_core`."
        " N is the number of agents,", "K that of rows of a long table. Frames are right-handed, z "
        "up; units are SI. Tables are frozen: make changed ones", "with `dataclasses.replace`.",
    ]  # fmt: skip
    for title, names in GROUPS.items():
        lines += ["", f"## {title}"]
        for name in names:
            lines += ["", f"### {name}", "", *_table(getattr(star_core, name))]
    return "\n".join(lines) + "\n"


def _table(owner: Any) -> Iterator[str]:
    doc = inspect.getdoc(owner) or ""
    summary, _, rest = doc.partition("\n\n")
    yield " ".join(summary.replace("``", "`").split())
    yield ""
    if issubclass(owner, Enum):
        yield "| member | value |"
        yield "|---|---|"
        yield from (f"| `{one.name}` | {one.value} |" for one in owner)
        return
    described = dict(_attributes(rest))
    shapes = dict(_shapes(owner))
    yield "| field | type | shape | content |" if shapes else "| field | type | content |"
    yield "|---|---|---|---|" if shapes else "|---|---|---|"
    hidden = {one.name for one in fields(owner) if not (one.init and one.repr)}  # for the core
    for name, annotation in owner.__annotations__.items():
        if name not in hidden:
            kind = annotation.replace("|", "or").removesuffix(" or None")
            shape = f" {shapes.get(name, '')} |" if shapes else ""
            yield f"| `{name}` | `{kind}` |{shape} {described[name].replace('|', chr(92) + '|')} |"


def _shapes(owner: Any) -> Iterator[tuple[str, str]]:
    """Yield names and shapes of the columns of a table: ``(N, 3)``."""
    for column in getattr(owner, "COLUMNS", ()):
        rows = (column.per or owner.PER)[0]
        size = ", ".join(map(str, column.row))
        yield column.name, f"({ {'a': 'N', 't': 'T'}.get(rows, 'K') }, {size})".replace(", )", ",)")


def _attributes(text: str) -> Iterator[tuple[str, str]]:
    """Yield names and descriptions of the section ``Attributes:`` of a docstring."""
    section = re.search(r"^Attributes:\n((?:^    .*\n?|\n)*)", text, re.MULTILINE)
    for name, words in re.findall(
        r"^    (\w+): ((?:.*\n?)(?:^     .*\n?)*)", section[1] if section else "", re.MULTILINE
    ):
        yield name, " ".join(words.replace("``", "`").split())


if __name__ == "__main__":
    PICTURE.write_text(diagram(), encoding="utf-8")
    TABLES.write_text(tables(), encoding="utf-8")
    for page in PAGES:
        page.write_text(with_examples(page.read_text("utf-8")), encoding="utf-8")
