"""What a plugin offers must fit into the mission language."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from star_core import Scene, fly, hookimpl
from star_core import load as load_mission
from star_core.discovery import Source
from star_core.errors import PluginError
from star_core.plugin_support.option_schema import STEP_KEYS, fill_defaults, sound
from star_core.plugin_support.registry import Found, Registry
from star_core.plugin_support.specs import AvoiderSpec, Exclusive, TaskSpec
from star_yaml.checks.plugin_checks import held

NEVER_MADE: Any = object
NO_MAP: Any = True
NAMES: Any = ("Orca", "", "two words", "é", 7)
EXCLUSIVE = Exclusive(options=("port",), unless="planner", timeout=5.0)


def offer(name: str, properties: dict[str, Any] | None = None, **rules: Any) -> TaskSpec:
    """An offer of a plugin that cannot do anything."""
    options = {"type": "object", "properties": properties or {}, **rules}
    return TaskSpec(name=name, summary=f"The {name}.", make=NEVER_MADE, options=options)


@pytest.mark.parametrize(
    ("kind", "broken", "message"),
    [
        ("avoider", offer("x", {"a": {"type": "nmuber"}}), "options.properties.a.type is not a JS"),
        ("avoider", offer("x", {"a": {"pattern": "("}}), "options.properties.a.pattern is not a J"),
        ("avoider", offer("x", {"a": {"default": float("nan")}}), "options are not JSON: "),
        ("avoider", offer("x", {"a": {"default": object()}}), "options are not JSON: "),
        ("avoider", offer("x", type="string"), "options are not the schema of an object, expected"),
        ("planner", replace(offer("x"), options=NO_MAP), "options are not the schema of an object"),
        ("avoider", offer("x", {"use": {}}), "option 'use' has a name that STAR uses itself"),
        ("avoider", offer("x", required=["a"]), "option 'a' is required but not among its prope"),
        ("avoider", offer("x", {"a": {"$ref": "#/$defs/a"}}), "options refer to '#/$defs/a', whi"),
        ("avoider", offer("x", {"a": {"$ref": "https://a.b/c"}}), "options refer to 'https://a.b"),
        *(("task", offer("x", {name: {}}), f"option '{name}' has a name that STAR uses")
          for name in ("agents", "timeout", "on_failure")),
        *(("task", offer(name), "STAR has a task of that name") for name in STEP_KEYS),
        *(("avoider", offer(name), "a name is lower-case letters, digits")
          for name in NAMES),
        ("task", replace(offer("x", {"port": {}}), exclusive=EXCLUSIVE), "exclusive names option "),
    ],
)  # fmt: skip
def test_a_plugin_whose_offer_is_unsound_is_named(
    kind: str, broken: TaskSpec, message: str
) -> None:
    with pytest.raises(PluginError) as caught:
        sound(kind, broken)
    assert str(caught.value).startswith(f"{kind} {broken.name!r}: {message}")


def _id(part: str | Found) -> str:
    return part if isinstance(part, str) else part.offer.name


@pytest.mark.parametrize(("kind", "plugin"), list(Registry()), ids=_id)
def test_what_star_offers_itself_is_sound(kind: str, plugin: Found) -> None:
    assert sound(kind, plugin.offer) == plugin.offer
    for option in getattr(plugin.offer, "options", {}).get("properties", {}).values():
        assert option["description"]
        optional = "default" in option or "Needed with" in option["description"]
        assert kind in {"task", "transport", "mocap_source"} or optional
        default = [option["default"]] if "default" in option else []
        for value in option.get("examples", []) + default:
            Draft202012Validator(option).validate(value)


def test_a_plugin_with_an_unsound_offer_is_left_out_whole() -> None:
    class Crooked:
        @hookimpl
        def star_tasks(self) -> list[TaskSpec]:
            return [offer("good"), offer("bad", {"a": {"type": "nmuber"}})]

    registry = Registry(installed=False)
    with pytest.raises(PluginError):
        registry.add(Crooked(), Source("crooked:plugin"))
    assert registry.names("task") == ()


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, (("host", None), ("port", 7))),
        ({"host": "here", "port": 8}, (("host", "here"), ("port", 8))),
        ({"port": 8, "planner": "orbit"}, ()),
    ],
)
def test_a_step_holds_what_its_options_identify(options: dict[str, Any], expected: Any) -> None:
    exclusive = Exclusive(options=("host", "port"), unless="planner", timeout=5.0)
    verb = replace(offer("x", {"host": {}, "port": {"default": 7}}), exclusive=exclusive)
    assert held(verb, options) == expected
    assert held(offer("x"), options) == ()


def test_absent_options_get_the_defaults_of_the_schema() -> None:
    inner = {"properties": {"rate": {"default": 5}, "name": {}}}
    schema = {"properties": {"gap": {"default": [1]}, "one": inner, "two": inner, "free": True}}
    filled = fill_defaults({"one": {"name": "x"}}, schema)
    assert filled == {"one": {"name": "x", "rate": 5}, "gap": [1]}
    filled["gap"].append(2)
    assert fill_defaults({"gap": [3]}, schema) == {"gap": [3]}
    assert fill_defaults({}, schema) == {"gap": [1]}


@pytest.mark.usefixtures("hop")
def test_a_plugin_is_made_with_the_defaults_of_its_schema() -> None:
    arguments: dict[str, Any] = {}

    def make(_scene: Scene, **options: Any) -> Any:
        arguments.update(options)

    class Theirs:
        @hookimpl
        def star_avoiders(self) -> Iterable[AvoiderSpec]:
            options = {"type": "object", "properties": {"gap": {"type": "number", "default": 2}}}
            yield AvoiderSpec(name="theirs", summary="Theirs.", make=make, options=options)

    registry = Registry(Theirs())
    with pytest.raises(PluginError, match="theirs"):
        fly(load_mission("hop.yaml", registry, ["avoider=theirs"]), registry)
    assert arguments == {"gap": 2}
