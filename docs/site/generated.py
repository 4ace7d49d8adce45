"""Pages made from the code: options of plugins, keys of files, commands, the Python API."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from star_basics.describe_plugin import MAX_DEPTH, allowed, resolved
from star_core import Registry
from star_core.commands.command_line import parser_of
from star_core.toolkit import flow

ROOT: Final = Path(__file__).parents[2]
BAR: Final = "\\|"  # in a table
NOTE: Final = "\nGenerated from the code when the site is built.\n"

KINDS: Final = {
    "transport": "A transport carries telemetry, setpoints and commands between STAR and a swarm, "
    "simulated or real. A mission names one: `transport: sim`.",
    "localizer": "A localizer estimates the positions of all agents from their telemetry. A "
    "mission names one: `localizer: flow`.",
    "planner": "A planner turns the goals of the steps into velocities, for each agent as if it "
    "were alone. A mission names one: `planner: straight`.",
    "avoider": "An avoider changes these velocities so that agents keep apart. A mission names "
    "one, with options if it has some: `avoider: {use: orca, radius: 0.25}`.",
    "task": "A verb is what a step of a mission does. All verbs also have the keys of every step: "
    "`agents`, `until`, `timeout` and `on_failure`.",
}
WRITE: Final = {kind: f"../plugins/{kind}.md" for kind in KINDS} | {"task": "../plugins/verb.md"}
ABOUT: Final = {"sim": "simulator.md", "radio": "hardware.md"}  # pages on transports

GROUPS: Final = {  # page, title, and prefixes of the modules whose public names it has
    "flights": ("Flights and records", ("runner", "operator", "mission", "formats", "records")),
    "contracts": ("Contracts and specs", ("contracts", "plugin_support")),
    "messages": ("Tables", ("messages",)),
    "scene": ("Scene and world", ("world",)),
    "errors": ("Errors", ("errors",)),
}

PACKAGES: Final = {  # pages of all public names of a package
    "toolkit": "What plugins share",
    "commands": "What commands share",
    "formats": "What formats of missions share",
    "testing": "Checks for the tests of plugins",
}

MODULES: Final = {  # pages of whole modules
    "hooks": ("Hooks", ["star_core.plugin_support.hookspecs"]),
    "external": ("External planners, search patterns and sources of motion capture",
                 ["star_external.planner", "star_mocap.source", "star_search.pattern",
                  "star_search.search_space"]),
}  # fmt: skip


def generated_pages() -> Iterator[tuple[str, str]]:
    """Yield the path of each page in the site, and its Markdown."""
    offers = Registry().offers()
    for kind in KINDS:
        yield f"reference/{_plural(kind)}.md", options_page(kind, offers[kind])
    yield "reference/files.md", files_page()
    yield "reference/commands.md", commands_page(offers["command"])
    yield "decisions/index.md", decisions_page()
    yield from _api_pages()


def options_page(kind: str, offers: Mapping[str, Any]) -> str:
    """Return the page of all plugins of a kind, with a table of options for each."""
    title = _plural(kind).capitalize()
    lines = [f"# {title}", "", f"{KINDS[kind]} [Write one]({WRITE[kind]})."]
    methods = (ROOT / "docs" / "methods.md").read_text("utf-8")
    for name, offer in offers.items():
        lines += ["", f"## `{name}`", "", offer.summary, ""]
        page = ABOUT.get(name, f"methods.md#{name}" * (f"\n### `{name}`\n" in methods))
        lines += [f"[How it works, and when to use it](../{page})", ""] if page else []
        lines += ["<div class=options markdown>", "", *table(offer.options), "", "</div>"]
        lines += [
            line
            for example in offer.options.get("examples", ())
            for line in ("", "```yaml", f"- {name}: {flow(example)}", "```")
        ]
    return "\n".join(lines) + "\n"


def files_page() -> str:
    """Return the page of the keys of missions and the other files."""
    lines = ["# Keys of files", "", "A dot separates nested keys; `NAME` is a name of your choice."]
    lines += [NOTE]
    registry = Registry()
    for kind in ("mission", "world", "camera", "study", "faults"):
        schema = registry.find("file_kind", kind).offer.schema(registry)
        if kind == "mission":  # without the options of plugins, which have their own pages
            schema = json.loads((ROOT / "schemas" / "mission.schema.json").read_text("utf-8"))
        lines += ["", f"## {kind.capitalize()}", "", schema["description"], ""]
        lines += ["<div class=options markdown>", "", *table(schema, "key"), "", "</div>"]
    return "\n".join(lines) + "\n"


def decisions_page() -> str:
    """Return the list of all decisions, by the area that the first words of each page name."""
    areas: dict[str, list[str]] = {}
    for page in sorted((ROOT / "docs" / "decisions").glob("*.md")):
        title, _, area = page.read_text("utf-8").split("\n", 3)[:3]
        areas.setdefault(area.split("*")[1].rstrip("."), []).append(
            f"- {page.name[:4]} [{title.removeprefix('# ')}]({page.name})"
        )
    lines = [
        "# Decisions",
        "",
        "Why the code is as it is: one decision a page, with its reason.",
        NOTE,
    ]
    lines += [line for area, rows in areas.items() for line in ("", f"## {area}", "", *rows)]
    return "\n".join(lines) + "\n"


def table(schema: Mapping[str, Any], title: str = "option") -> list[str]:
    """Return a table of an object's properties, with nested ones below their parent."""
    rows = list(_rows(schema, schema.get("$defs", {}), ""))
    if not rows:
        return ["No options."]
    return [f"| {title} | value | default | description |", "|---|---|---|---|", *rows]


def _rows(schema: Mapping[str, Any], shared: Mapping[str, Any], above: str) -> Iterator[str]:
    for key, written in schema.get("properties", {}).items():
        name, rules = above + key, resolved(written, shared)
        default = f"`{flow(rules['default'])}`" if "default" in rules else ""
        if key in schema.get("required", ()):
            default = "required"
        cells = f"`{name}`", allowed(rules, shared), default, rules.get("description", "")
        yield f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |"
        if name.count(".") < MAX_DEPTH and rules.get("items") != {"$ref": "#/$defs/step"}:
            yield from _rows(rules, shared, f"{name}.")
            yield from _rows(resolved(rules.get("items"), shared), shared, f"{name}.")
            named = resolved(rules.get("additionalProperties"), shared)
            yield from _rows(named, shared, f"{name}.NAME.")


def commands_page(offers: Mapping[str, Any]) -> str:
    """Return the page with the ``--help`` of every command."""
    lines = ["# Commands", NOTE]
    for name in offers:
        lines += ["", f"## `star {name}`", "", "```text", _help(offers[name], []), "```"]
        if name == "calibrate":
            lines += ["", "```text", _help(offers[name], ["camera"]), "```"]
    return "\n".join(lines) + "\n"


def _help(offer: Any, arguments: list[str]) -> str:
    printed = io.StringIO()
    os.environ["COLUMNS"] = "100"
    with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        parser_of(offer).parse_args([*arguments, "--help"])
    return printed.getvalue().rstrip()


def _api_pages() -> Iterator[tuple[str, str]]:
    """Yield the pages of all public names, by `GROUPS` and `PACKAGES`, and of whole modules."""
    pages: dict[str, list[str]] = {page: [] for page in GROUPS}
    of = {prefix: page for page, (_, prefixes) in GROUPS.items() for prefix in prefixes}
    for name in _public_names("star_core"):
        pages[of[name.split(".")[1]]].append(name)
    for page, (title, _) in GROUPS.items():
        yield _api_page(page, title, "star_core", pages[page])
    for page, title in PACKAGES.items():
        yield _api_page(page, title, f"star_core.{page}", _public_names(f"star_core.{page}"))
    for page, (title, modules) in MODULES.items():
        blocks = "".join(f"\n::: {module}\n" for module in modules)
        yield f"reference/api/{page}.md", f"# {title}\n{blocks}"


def _public_names(package: str) -> list[str]:
    text = ROOT.joinpath(*package.split("."), "__init__.pyi").read_text("utf-8")
    rows = re.findall(r"^from (star_core\.\S+) import (\w+) as", text, re.MULTILINE)
    return [f"{module}.{name}" for module, name in rows]


def _api_page(page: str, title: str, package: str, names: list[str]) -> tuple[str, str]:
    blocks = "".join(f"\n::: {name}\n" for name in names if not name.endswith("hookimpl"))
    hidden = "members: false, show_root_heading: false, show_root_toc_entry: false"
    about = f"::: {package}\n    options: {{{hidden}}}\n"
    text = about * (page == "testing") + f"\nImport these from `{package}`.\n{blocks}"
    return f"reference/api/{page}.md", f"# {title}\n\n{text}"


def _plural(kind: str) -> str:
    return "verbs" if kind == "task" else f"{kind}s"
