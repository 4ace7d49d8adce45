"""What plugins add to ``star``: how they are listed, the schema, and their commands."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import pytest

from star_basics.describe_plugin import describe
from star_basics.list_plugins import as_json, as_text, chosen
from star_core import AvoiderSpec, InputError, TaskSpec, hookimpl
from star_core.commands import CommandSpec
from star_core.commands.main import main
from star_core.discovery import Source
from star_core.plugin_support.registry import Registry
from star_yaml.editor_schema import for_editors
from star_yaml.schema import compose, compose_steps, load
from tests.commands import Printed


class Shelf:
    """A plugin that offers avoiders and verbs.

    Args:
        avoiders: Options of each avoider, by name.
        verbs: Options of each verb, by name.
    """

    def __init__(
        self, avoiders: Mapping[str, Any] | None = None, verbs: Mapping[str, Any] | None = None
    ) -> None:
        self._avoiders = avoiders or {}
        self._verbs = verbs or {}

    @hookimpl
    def star_avoiders(self) -> Iterable[AvoiderSpec]:
        return [_offer(name, options, AvoiderSpec) for name, options in self._avoiders.items()]

    @hookimpl
    def star_tasks(self) -> Iterable[TaskSpec]:
        return [_offer(name, options) for name, options in self._verbs.items()]


def _offer(name: str, options: Mapping[str, Any], spec: Any = TaskSpec) -> Any:
    return spec(name=name, summary=f"The {name}.", make=cast("Any", object), options=options)


def registry(
    avoiders: Mapping[str, Any] | None = None, verbs: Mapping[str, Any] | None = None
) -> Registry:
    """A registry of one plugin, of the distribution ``their-dist``."""
    only = Registry(installed=False)
    only.add(Shelf(avoiders, verbs), Source("their-dist:shelf", "1.2"))
    return only


def table(plugins: Registry) -> str:
    return as_text(chosen(plugins), plugins.broken)


def listed(plugins: Registry) -> Any:
    return json.loads(as_json(chosen(plugins), plugins.broken))


def with_options(properties: Mapping[str, Any], **rules: Any) -> list[str]:
    """The lines about the options of an avoider."""
    ((kind, shy),) = chosen(registry({"shy": {"properties": properties, **rules}}), "shy")
    text = describe(kind, shy).partition("Options:\n")[2].partition("\n\n")[0]
    return [line.strip() for line in text.splitlines()]


@pytest.fixture
def printed(capsys: Printed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Printed:
    """What a command prints that is given in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return capsys


# For people


def test_plugins_stand_below_their_kind_with_their_distribution() -> None:
    assert table(registry({"shy": {}, "bold": {}}, {"wait": {}})).splitlines() == [
        "avoiders",
        "  bold  The bold.  [their-dist 1.2:shelf]",
        "  shy   The shy.  [their-dist 1.2:shelf]",
        "",
        "tasks",
        "  wait  The wait.  [their-dist 1.2:shelf]",
        "",
        "`star plugins NAME` describes a plugin and its options.",
    ]


def test_two_plugins_of_one_name_are_both_listed() -> None:
    both = registry({"shy": {}})
    both.add(Shelf({"shy": {}}), Source("my-dist:shelf"))
    text = table(both)
    assert "[their-dist 1.2:shelf]" in text
    assert "[my-dist:shelf]" in text
    assert len(chosen(both, "shy")) == 2


def test_left_out_plugins_are_listed_last_with_the_reason() -> None:
    some = registry({"shy": {}})
    some.broken[Source("bad-dist:bad", "0.1")] = "ImportError: no torch"
    assert table(some).splitlines()[-1] == "left out: bad-dist 0.1:bad: ImportError: no torch"


# One plugin


def test_an_example_has_the_options_that_are_required() -> None:
    options = {"properties": {"share": {"default": 1}, "of": {}}, "required": ["of"]}
    plugins = registry({"shy": options}, {"bow": options})
    ((kind, shy),) = chosen(plugins, "shy")
    assert "Example: avoider: {use: shy, of: ...}" in describe(kind, shy)
    ((kind, bow),) = chosen(plugins, "bow")
    assert "Example: - bow: {of: ...}." in describe(kind, bow)


@pytest.mark.parametrize(
    ("rules", "shown"),
    [
        ({"type": "number", "minimum": 0, "maximum": 1}, "number from 0 to 1"),
        ({"type": "integer", "exclusiveMinimum": 0, "maximum": 9}, "integer > 0 and ≤ 9"),
        ({"type": ["number", "null"], "minimum": 0}, "number ≥ 0, or null"),
        ({"enum": ["hold", None, 3]}, "hold | null | 3"),
        ({"type": "boolean"}, "true | false"),
        ({"type": "string"}, "string"),
        ({"type": "array", "items": {"type": "string"}}, "list of strings"),
        ({"type": "array"}, "list of values"),
        ({"type": "object", "additionalProperties": {"type": "number"}}, "map of names to numbers"),
        ({"anyOf": [{"type": "number"}, {"const": "auto"}]}, "number, or auto"),
        ({"$ref": "#/$defs/share"}, "number from 0 to 1"),
    ],
)
def test_an_option_is_described_with_the_values_it_allows(rules: Any, shown: str) -> None:
    share = {"type": "number", "minimum": 0, "maximum": 1}
    assert with_options({"a": rules}, **{"$defs": {"share": share}}) == [f"a: {shown}"]


def test_keys_of_maps_are_described_too() -> None:
    camera = {
        "type": "object",
        "required": ["rate"],
        "description": "The camera.",
        "properties": {"rate": {"type": "number", "description": "Images, 1/s."}},
    }
    assert with_options({"camera": camera}) == [
        "camera: map", "The camera.", "camera.rate: number; required", "Images, 1/s.",
    ]  # fmt: skip


def test_recursive_options_are_described_to_a_limited_depth() -> None:
    tree = {"type": "object", "properties": {"in": {"$ref": "#/$defs/tree"}}}
    lines = with_options({"tree": {"$ref": "#/$defs/tree"}}, **{"$defs": {"tree": tree}})
    assert lines[-1] == "tree.in.in.in.in: map"


@pytest.mark.parametrize(
    ("default", "shown"), [(True, "true"), (None, "null"), ("left", "left"), ([1, 2], "[1, 2]")]
)
def test_a_default_is_shown_as_a_mission_writes_it(default: object, shown: str) -> None:
    (line,) = with_options({"a": {"type": "string", "default": default}})
    assert line == f"a: string; default {shown}"


@pytest.mark.parametrize("columns", ["80", "200"])
def test_descriptions_fit_the_terminal(columns: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    plugins = Registry()
    text = "\n".join(describe(kind, plugin) for kind, plugin in chosen(plugins)) + table(plugins)
    assert max(map(len, text.splitlines())) <= min(100, int(columns))


@pytest.mark.parametrize(
    ("name", "matches"),
    [
        ("sim", {("transport", "sim")}),
        ("mcap", {("command", "recover"), ("observer", "mcap")}),
        ("localizers", {("localizer", name) for name in ("apriltag", "flow", "mocap", "onboard")}),
    ],
)
def test_names_match_plugins_entry_points_and_kinds(
    name: str, matches: set[tuple[str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("STAR_BLOCK_PLUGINS")  # of the plugin mcap
    assert {(kind, plugin.offer.name) for kind, plugin in chosen(Registry(), name)} == matches


def test_a_verb_is_a_task() -> None:
    registry = Registry()
    assert chosen(registry, "verb") == chosen(registry, "task") != []


def test_observers_are_the_plugins_that_observe_flights() -> None:
    class Advisor:
        @hookimpl
        def star_check(self) -> list[object]:
            return []

    class Watcher:
        """Observer: counts nothing."""

        @hookimpl
        def star_ticked(self) -> None: ...

    ((kind, plugin),) = chosen(Registry(Advisor(), Watcher(), installed=False))
    assert (kind, plugin.offer.summary) == ("observer", "Counts nothing.")


def test_an_unknown_name_is_refused_with_the_nearest_one(printed: Printed) -> None:
    assert main(["plugins", "orka"]) == 2
    err = printed.readouterr().err
    assert err == "no plugin named 'orka'; did you mean 'orca'? [unknown-plugin]\n"


def test_a_plugin_is_described_with_an_example(printed: Printed) -> None:
    assert main(["plugins", "orca"]) == 0
    lines = printed.readouterr().out.splitlines()
    assert lines[0].startswith("orca: avoider of star-swarm ")
    assert lines[-1] == "  Example: avoider: {use: orca, radius: 0.2}"
    assert "    radius: number > 0; default 0.2" in lines


# For scripts


def test_the_json_holds_what_the_text_reports() -> None:
    options = {"type": "object", "properties": {"gain": {"type": "number", "default": 2.5}}}
    some = registry({"shy": options})
    some.broken[Source("bad-dist:bad", "0.1")] = "ImportError: no torch"
    assert listed(some) == {
        "plugins": [
            {
                "kind": "avoider",
                "name": "shy",
                "summary": "The shy.",
                "plugin": "their-dist:shelf",
                "version": "1.2",
                "options": options,
            }
        ],
        "broken": {"bad-dist 0.1:bad": "ImportError: no torch"},
    }


def test_the_json_holds_options_that_are_mappings_of_any_kind() -> None:
    properties = MappingProxyType({"gain": MappingProxyType({"type": "number"})})
    (shy,) = listed(registry({"shy": {"properties": properties}}))["plugins"]
    assert shy["options"] == {"properties": {"gain": {"type": "number"}}}


# What is installed


def test_built_in_plugins_are_listed_in_order_of_kind(printed: Printed) -> None:
    assert main(["plugins", "--json"]) == 0
    plugins = json.loads(printed.readouterr().out)["plugins"]
    listing = [(plugin["kind"], plugin["name"]) for plugin in plugins]
    kinds = (*Registry().kinds, "observer")
    assert listing == sorted(listing, key=lambda row: (kinds.index(row[0]), row[1]))
    assert {
        ("transport", "sim"),
        ("localizer", "flow"),
        ("planner", "straight"),
        ("avoider", "none"),
        ("avoider", "orca"),
        *(("task", verb) for verb in ("follow", "goto", "hold", "land", "takeoff")),
    } <= set(listing)


def test_every_option_of_a_built_in_plugin_has_a_description() -> None:
    for kind, plugin in Registry():
        options = getattr(plugin.offer, "options", {})  # a command has none
        for name, option in options.get("properties", {}).items():
            assert option.get("description"), f"{kind} {plugin.offer.name}: {name}"


# star plugins, star schema


def test_schemas_for_editors_are_printed(printed: Printed) -> None:
    offers = Registry().offers()
    steps = for_editors(compose_steps(offers), parameters=True)
    for name, schema in {
        "mission": for_editors(compose(offers), parameters=True),
        "steps": steps,
        "world": for_editors(load("world")),
    }.items():
        assert main(["schema", name]) == 0
        assert json.loads(printed.readouterr().out) == schema
    verbs = compose(offers)["$defs"]["step"]["properties"]
    assert list(steps["$defs"]["step"]["properties"]) == list(verbs)
    assert "takeoff" in verbs
    assert steps["$defs"]["timeout"]["type"] == ["number", "string"]


def test_a_schema_is_written_to_a_file_in_place_of_being_printed(printed: Printed) -> None:
    assert main(["schema", "--out", "mission.schema.json"]) == 0
    assert printed.readouterr().out == ""
    written = json.loads(Path("mission.schema.json").read_text())
    assert written == for_editors(compose(Registry().offers()), parameters=True)


def test_a_schema_that_cannot_be_written_reports_why(printed: Printed) -> None:
    assert main(["schema", "--out", "nowhere/x.json"]) == 2
    assert main(["schema", "--out", "."]) == 2
    assert printed.readouterr() == (
        "",
        "nowhere/x.json: cannot be written: No such file or directory [unwritable-file]\n"
        ".: cannot be written: Is a directory [unwritable-file]\n",
    )


def test_left_out_plugins_are_reported_on_stderr_too(
    printed: Printed, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Broken:
        name, dist = "broken", None

        def load(self) -> object:
            raise ImportError("no torch")

        def __lt__(self, other: object) -> bool:
            return True

    own = entry_points(group="star.plugins", name="basics")
    lookup = "star_core.discovery.entry_points"
    monkeypatch.setattr(lookup, lambda **_: [*own, Broken()])
    assert main(["plugins"]) == 0
    out, err = printed.readouterr()
    assert err == "star: plugin broken is left out: ImportError: no torch\n"
    assert out.endswith("left out: broken: ImportError: no torch\n")


# Commands of plugins


class Greeter:
    """A plugin that adds the command ``greet``."""

    @hookimpl
    def star_commands(self) -> Iterable[CommandSpec]:
        def configure(line: ArgumentParser) -> None:
            line.add_argument("names", nargs="*")
            line.add_argument("--loudly", action="store_true")

        def greet(options: Namespace, registry: Registry) -> int:
            assert "greet" in registry.names("command")
            if not options.names:
                raise InputError(["no name to greet; give one"])
            status: int = [0, 1, 2, 3][len(options.names) + options.loudly]
            return status

        return [CommandSpec(name="greet", summary="Greets.", configure=configure, run=greet)]


def test_every_command_has_help(printed: Printed) -> None:
    for name in Registry().names("command"):
        with pytest.raises(SystemExit, match="0"):
            main([name, "--help"])
        assert printed.readouterr().out.startswith(f"usage: star {name} ")


def test_plugin_commands_receive_options_and_return_the_status(
    with_plugin: Callable[[object], None],
) -> None:
    with_plugin(Greeter())
    assert main(["greet", "cf1", "--loudly", "cf2"]) == 3


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["great"], "star has no command 'great'; did you mean 'greet'? [invalid-argument]\n"),
        (["greet"], "no name to greet; give one [invalid-input]\n"),
        (["greet", *"abcd"], "command 'greet' (their-dist 1.2:theirs): IndexError: list index out"),
        (["greet", "cf1", "--loud"], "unknown option '--loud'; did you mean '--loudly'? [unknown-"),
        (["tags", "--papre", "w.yaml"], "unknown option '--papre'; did you mean '--paper'? ["),
        (["new", "world", "lab", "more"], "'more' is one argument too many [invalid-argument]"),
    ],
)
def test_what_a_command_refuses_or_raises_exits_with_2(
    printed: Printed, with_plugin: Callable[[object], None], arguments: list[str], why: str
) -> None:
    with_plugin(Greeter())
    assert main(arguments) == 2
    assert printed.readouterr().err.startswith(why)


# Readers that go away

ENTER = "import sys; from star_core.commands.main import main; sys.exit(main())"


@pytest.mark.parametrize("argument", ["schema", "--help"])  # more than a buffer holds, and less
def test_a_reader_that_goes_away_is_not_answered_by_an_error(argument: str) -> None:
    as_usual = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}
    with subprocess.Popen(
        [sys.executable, "-c", ENTER, argument],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=as_usual,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode in {0, 1}
