"""Whether what a plugin offers can be part of the mission language."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any, Final, TypeVar
from urllib.parse import unquote

from star_core.contracts import MissionSpec, Spec, TaskSpec
from star_core.errors import PluginError

AnySpec = TypeVar("AnySpec", bound=Spec)
AnyMissionSpec = TypeVar("AnyMissionSpec", bound=MissionSpec)

PARTS: Final = ("transport", "localizer", "planner", "avoider")
"""Kinds of plugins that a mission chooses, each by name or as ``{use: name, ...options}``."""

SHARED: Final = ("agents", "until", "timeout", "on_failure")
"""What every verb of a plugin takes beside its own options; the core itself handles it."""

JOIN, LEAVE = "join", "leave"
"""Verbs before which, and after which, the core changes the agents of the mission."""

RESERVE: Final = {"relieve_below": 3.7, "ready_above": 4.0, "height": 0.8}
"""What a mission need not say of its ``reserve``: V, V, m. The mission schema says the same."""

RESERVED: Final = {"task": SHARED}
"""Names no option of a kind may have; those of the parts are chosen by ``use``."""

OWN: Final = {
    "task": ("parallel", "repeat", "each", "include"),
    "command": ("run", "check", "errors", "plugins", "schema"),
}
"""Names that STAR has taken itself."""


def sound(kind: str, offer: AnySpec, *, trusted: bool = False) -> AnySpec:
    """Return `offer` with its options as plain JSON.

    Args:
        kind: Of plugin.
        offer: To be held to the rules.
        trusted: Do not look whether its options are a JSON Schema, which takes a while.

    Raises:
        PluginError: Its name is none, or is one that STAR has itself; or its options are no JSON
            Schema of an object, refer to what is not there, or have a name that STAR uses itself.
    """
    plugin = f"{kind} {offer.name!r}"
    if not re.fullmatch(r"[a-z][a-z0-9_-]*", str(offer.name)):
        raise PluginError(f"{plugin}: a name is lower-case letters, digits, '_' and '-'")
    if offer.name in OWN.get(kind, ()) and not (trusted and kind == "command"):
        raise PluginError(f"{plugin}: STAR has a {kind} of that name itself")
    return _with_options(kind, offer, trusted=trusted) if isinstance(offer, MissionSpec) else offer


def _with_options(kind: str, offer: AnyMissionSpec, *, trusted: bool) -> AnyMissionSpec:
    """Return `offer` with its options as plain JSON, which are checked."""
    plugin = f"{kind} {offer.name!r}"
    options = _plain(plugin, offer.options, trusted=trusted)
    properties = options.setdefault("properties", {})
    for name in RESERVED.get(kind, ("use",)):
        if name in properties:
            raise PluginError(f"{plugin}: option {name!r} has a name that STAR uses itself")
    for name in options.get("required", ()):
        if name not in properties and name not in RESERVED.get(kind, ()):
            raise PluginError(f"{plugin}: option {name!r} is required but not among its properties")
    for holder in references(options):
        if not _is_there(holder["$ref"], options):
            raise PluginError(f"{plugin}: options refer to {holder['$ref']!r}, which is not there")
    for name in _exclusive(offer):
        if name not in properties:
            raise PluginError(f"{plugin}: exclusive names option {name!r}, which is not there")
    return replace(offer, options=options)


def _exclusive(offer: MissionSpec) -> Iterator[str]:
    """Yield the options that a task names in its `Exclusive`."""
    if isinstance(offer, TaskSpec) and offer.exclusive is not None:
        yield from offer.exclusive.options
        if offer.exclusive.unless is not None:
            yield offer.exclusive.unless


def held(offer: TaskSpec, given: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """Return the options that identify what a step holds outside of STAR, with their values."""
    exclusive = offer.exclusive
    if exclusive is None or exclusive.unless in given:
        return ()
    known = offer.options.get("properties", {})
    return tuple((name, given.get(name, known[name].get("default"))) for name in exclusive.options)


def fill_defaults(options: Mapping[str, Any], schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with the defaults of their schema for those that are not given.

    The defaults inside of maps that are given are filled in too.

    Example:
        >>> fill_defaults({"radius": 0.3}, {"properties": {"radius": {}, "gain": {"default": 2}}})
        {'radius': 0.3, 'gain': 2}
    """
    filled = dict(options)
    for name, rules in schema.get("properties", {}).items():
        if name not in filled and isinstance(rules, dict) and "default" in rules:
            filled[name] = deepcopy(rules["default"])
        elif isinstance(filled.get(name), dict) and isinstance(rules, dict):
            filled[name] = fill_defaults(filled[name], rules)
    return filled


def references(schema: Any) -> Iterator[dict[str, Any]]:
    """Find every map with a ``$ref`` in it."""
    waiting = [schema]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            if isinstance(value.get("$ref"), str):
                yield value
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value


def _plain(plugin: str, options: Mapping[str, Any], *, trusted: bool) -> dict[str, Any]:
    """Return a copy of a plugin's options as plain JSON."""
    try:
        copy = json.loads(json.dumps(options, default=dict, allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise PluginError(f"{plugin}: options are no JSON: {error}") from error
    if not trusted:
        _must_be_schema(plugin, copy)
    if not isinstance(copy, dict) or copy.get("type", "object") != "object":
        raise PluginError(f"{plugin}: options are no schema of an object, expected type: object")
    return {key: value for key, value in copy.items() if key not in {"$schema", "$id"}}


def _must_be_schema(plugin: str, options: Any) -> None:
    from jsonschema import Draft202012Validator, SchemaError

    try:
        Draft202012Validator.check_schema(options)
    except SchemaError as error:
        where = ".".join(str(part) for part in ("options", *error.absolute_path))
        raise PluginError(f"{plugin}: {where} is no JSON Schema: {error.message}") from error
    except RecursionError as error:
        raise PluginError(f"{plugin}: options are no JSON: {error}") from error


def _is_there(reference: str, schema: Any) -> bool:
    """Whether a JSON pointer (``#/$defs/point``) leads somewhere in a schema."""
    start, *names = unquote(reference).split("/")
    for name in names:
        found = name.replace("~1", "/").replace("~0", "~")
        if isinstance(schema, list) and found.isdecimal() and int(found) < len(schema):
            schema = schema[int(found)]
        elif isinstance(schema, dict) and found in schema:
            schema = schema[found]
        else:
            return False
    return start == "#"
