"""What a plugin offers must fit into the mission language."""

from __future__ import annotations

from typing import Any

import pytest

from star_core.cli import COMMANDS
from star_core.contracts import Offer
from star_core.errors import PluginError
from star_core.options import RESERVE, sound
from star_core.registry import Found, Registry, Source
from star_core.schema import load


def offer(name: str, properties: dict[str, Any] | None = None, **rules: Any) -> Offer[Any]:
    """An offer of a plugin that cannot do anything."""
    options = {"type": "object", "properties": properties or {}, **rules}
    return Offer(name=name, summary=f"The {name}.", make=object, options=options)


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (offer("x", {"a": {"type": "nmuber"}}), "options.properties.a.type is no JSON Schema: "),
        (offer("x", {"a": {"pattern": "("}}), "options.properties.a.pattern is no JSON Schema: "),
        (offer("x", {"a": {"default": float("nan")}}), "options are no JSON: "),
        (offer("x", {"a": {"default": object()}}), "options are no JSON: "),
        (offer("x", type="string"), "options are no schema of an object, expected type: object"),
        (offer("x", {"use": {}}), "option 'use' has a name that STAR uses itself"),
        (offer("x", required=["a"]), "option 'a' is required but not among its properties"),
        (offer("x", {"a": {"$ref": "#/$defs/a"}}), "options refer to '#/$defs/a', which is not"),
        (offer("x", {"a": {"$ref": "https://a.b/c"}}), "options refer to 'https://a.b/c', which"),
    ],
)
def test_a_plugin_whose_options_are_no_schema_is_named(broken: Offer[Any], message: str) -> None:
    with pytest.raises(PluginError) as caught:
        sound("avoider", broken)
    assert str(caught.value).startswith(f"avoider 'x': {message}")


def test_options_that_are_true_are_no_schema_of_an_object() -> None:
    broken = Offer(name="x", summary="", make=object, options=True)  # type: ignore[arg-type]
    with pytest.raises(PluginError, match=r"^planner 'x': options are no schema of an object"):
        sound("planner", broken)


@pytest.mark.parametrize("name", ["agents", "timeout", "on_failure"])
def test_a_verb_cannot_have_an_option_that_every_verb_has(name: str) -> None:
    with pytest.raises(PluginError, match=rf"^task 'x': option '{name}' has a name that STAR"):
        sound("task", offer("x", {name: {}}))


@pytest.mark.parametrize(
    ("kind", "name"),
    [("task", "parallel"), ("task", "repeat"), *(("command", c) for c in COMMANDS)],
)
def test_nothing_can_be_called_like_one_of_stars_own(kind: str, name: str) -> None:
    with pytest.raises(PluginError, match=rf"^{kind} '{name}': STAR has a {kind} of that name"):
        sound(kind, offer(name))


@pytest.mark.parametrize("name", ["Orca", "", "two words", "é", 7])
def test_a_name_is_plain(name: Any) -> None:
    with pytest.raises(PluginError, match=r"^avoider .*: a name is lower-case letters, digits"):
        sound("avoider", offer(name))


def _id(part: str | Found) -> str:
    return part if isinstance(part, str) else part.offer.name


@pytest.mark.parametrize(("kind", "found"), list(Registry()), ids=_id)
def test_what_star_offers_itself_is_sound(kind: str, found: Found) -> None:
    assert sound(kind, found.offer) == found.offer


def test_a_plugin_with_an_unsound_offer_is_left_out_whole() -> None:
    class Crooked:
        def star_avoiders(self) -> list[Offer[Any]]:
            return [offer("good"), offer("bad", {"a": {"type": "nmuber"}})]

    registry = Registry(installed=False)
    with pytest.raises(PluginError, match=r"^avoider 'bad': options\.properties\.a\.type is no"):
        registry.add(Crooked(), Source("crooked:plugin"))
    assert registry.names("avoider") == ()


def test_a_reserve_is_taken_for_what_the_schema_says_of_it() -> None:
    said = load("mission")["properties"]["reserve"]["properties"]
    assert {name: said[name]["default"] for name in RESERVE} == RESERVE
