"""Command line of ``star new``: fills templates in and writes them."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Final

from star_core import InputError, Registry
from star_core.commands import writing

KINDS: Final = (
    "avoider", "planner", "localizer", "transport", "verb",
    "external-planner", "monitor", "observer", "command",
)  # fmt: skip
NAME: Final = re.compile("[a-z][a-z0-9]*([_-][a-z0-9]+)*")

LINE: Final = {  # of the mission that flies a new plugin
    "transport": "transport: sim",
    "localizer": "localizer: flow",
    "planner": "planner: straight",
    "avoider": "avoider: {use: orca, radius: 0.3}",
}
STEP: Final = "  - goto: {agents: cf1, by: [0.5, 0.5, 0]}"


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Write the files and return the exit status, 0.

    Raises:
        InputError: The name cannot be used, a file exists already or cannot be written.
    """
    name = options.name
    if not NAME.fullmatch(name):
        text = f"{name!r}: expected a name of lower-case letters, digits, '-' and '_'"
        raise InputError(text, "invalid-name")
    if options.what == "plugin" and options.kind is None:
        raise InputError(f"--kind: expected one of: {', '.join(KINDS)}", "missing-option")
    if options.what == "plugin" and any(
        plugin.source.own and plugin.offer.name == name for _, plugin in registry
    ):
        text = f"{name!r}: STAR has a plugin of that name itself; choose another name"
        raise InputError(text, "duplicate-name")
    files = _files(options.what, name, options.kind)
    content = {Path(path): text for path, text in files}
    for path in content:
        if path.exists():
            raise InputError(f"{path}: exists already; choose another name", "file-exists")
    for path, text in content.items():
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        sys.stdout.write(f"{path}\n")
    sys.stdout.write(f"next: {_next(options.what, name)}\n")
    return 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Write files to begin with, into the current folder: a mission with its world "
        "that flies, a world, a study with its mission, or a plugin with a test and a mission "
        "that use it."
    )
    line.add_argument("what", choices=["mission", "world", "study", "plugin"])
    line.add_argument("name", help="lower-case letters, digits, '-' and '_'")
    line.add_argument("--kind", type=_kind, choices=KINDS, help="of a plugin")


def _kind(text: str) -> str:
    """Return a kind; a verb is a task to the core, and in `star plugins`."""
    return "verb" if text == "task" else text


def _files(what: str, name: str, kind: str | None) -> Iterator[tuple[str, str]]:
    """Yield paths and contents."""
    if what == "world":
        yield f"{name}.yaml", _filled("world.yaml", name=name)
        return
    if what == "study":
        yield f"{name}.yaml", _filled("study.yaml", name=name)
        name = f"{name}_mission"
    if what in {"mission", "study"} or kind is None:
        yield f"{name}.yaml", _mission(name, LINE, STEP)
        yield f"{name}_world.yaml", _filled("world.yaml", name=f"{name}_world")
        return
    package, folder = f"star_{name.replace('-', '_')}", f"star-{name}"
    word = name.replace("-", "_")
    title = "".join(part.capitalize() for part in word.split("_"))
    values = {"name": word, "package": package, "folder": folder, "kind": kind, "title": title}
    lines, step = dict(LINE), STEP
    if kind in lines:
        lines[kind] = f"{kind}: {word}"
    if kind == "verb":
        step = f"  - {word}: {{agents: cf1, height: 0.3}}"
    if kind == "external-planner":
        step = f"  - external: {{planner: {word}}}"
    for template, path in (
        ("pyproject.toml", "pyproject.toml"),
        ("README.md", "README.md"),
        (f"{kind}_init.py", f"{package}/__init__.py"),
        (f"{kind}.py", f"{package}/{kind}.py"),
        (f"{kind}_test.py", f"test_{package}.py"),
    ):
        if (files("star_new") / "templates" / f"{template}.tmpl").is_file():
            yield f"{folder}/{path}", _filled(template, **values)
    yield f"{folder}/{word}.yaml", _mission(word, lines, step)
    yield f"{folder}/{word}_world.yaml", _filled("world.yaml", name=f"{word}_world")


def _mission(name: str, lines: Mapping[str, str], step: str) -> str:
    return _filled("mission.yaml", name=name, plugins="\n".join(lines.values()), step=step)


def _filled(template: str, **values: str) -> str:
    text = (files("star_new") / "templates" / f"{template}.tmpl").read_text(encoding="utf-8")
    return Template(text).substitute(values)


def _next(what: str, name: str) -> str:
    if what == "world":
        return f"star check {name}.yaml"
    if what == "mission":
        return f"star run {name}.yaml"
    if what == "study":
        return f"star ablate {name}.yaml"
    return f"pip install -e 'star-{name}[test]' && pytest star-{name}"
