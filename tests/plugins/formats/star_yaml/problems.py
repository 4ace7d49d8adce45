"""Documents and offers for tests, and where missions are wrong: the corpus has the words."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from star_core import InputError, Registry, TaskSpec, load
from star_yaml.document import Document
from star_yaml.yaml_reader import parse
from tests.commands import position_and_code


def document(text: str) -> Document:
    """Return a document that is called ``m.yaml``."""
    return Document(parse(text, "m.yaml"), Path("m.yaml"))


def offer(name: str, properties: dict[str, Any] | None = None, **rules: Any) -> TaskSpec:
    """Return an offer of a plugin that cannot do anything."""
    options = {"type": "object", "properties": properties or {}, **rules}
    make: Any = object
    return TaskSpec(name=name, summary=f"The {name}.", make=make, options=options)


def problems(text: str, registry: Registry | None = None) -> list[str]:
    """Return ``line:column [code]`` of every problem of a mission; none if it can be flown."""
    Path("m.yaml").write_text(text)
    try:
        load("m.yaml", registry or Registry())
    except InputError as error:
        return [position_and_code(problem).removeprefix("m.yaml:") for problem in error.problems]
    return []


def of_steps(head: str, steps: Sequence[str]) -> list[str]:
    """Return the problems of a mission with these steps, each on its line: ``step 1:5 [code]``."""
    before = head.count("\n")
    relative = []
    for problem in problems(head + "".join(f"  - {step}\n" for step in steps)):
        line, _, rest = problem.partition(":")
        within = int(line) - before
        relative.append(f"step {within}:{rest}" if within > 0 else problem)
    return relative
