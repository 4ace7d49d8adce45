"""Whether what a plugin offers can be part of the mission language."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final
from urllib.parse import unquote

from star_core.contracts import Offer
from star_core.errors import PluginError

SHARED: Final = ("agents", "until", "timeout", "on_failure")
"""What every verb of a plugin takes beside its own options; the core itself handles it."""

JOIN, LEAVE = "join", "leave"
"""Verbs before which, and after which, the core changes who is in the mission."""

RESERVE: Final = {"relieve_below": 3.7, "ready_above": 4.0, "height": 0.8}
"""What a mission need not say of its ``reserve``: V, V, m. The mission schema says the same."""

RESERVED: Final = {"task": SHARED, "command": ()}
"""Names no option of a kind may have; those of the parts are chosen by ``use``."""

OWN: Final = {
    "task": ("parallel", "repeat", "each", "include"),
    "command": ("run", "check", "plugins", "schema"),
}
"""Names that STAR has taken itself."""


def sound(kind: str, offer: Offer[Any], *, trusted: bool = False) -> Offer[Any]:
    """Return `offer` with its options as plain JSON.

    Args:
        kind: Of plugin.
        offer: To be held to the rules.
        trusted: Do not look whether its options are a JSON Schema, which takes a while.

    Raises:
        PluginError: Its name is none, or is one that STAR has itself; or its options are no JSON
            Schema of an object, refer to what is not there, or have a name that STAR uses itself.
    """
    who = f"{kind} {offer.name!r}"
    if not re.fullmatch(r"[a-z][a-z0-9_-]*", str(offer.name)):
        raise PluginError(f"{who}: a name is lower-case letters, digits, '_' and '-'")
    if offer.name in OWN.get(kind, ()):
        raise PluginError(f"{who}: STAR has a {kind} of that name itself")
    options = _plain(who, offer.options, trusted=trusted)
    properties = options.setdefault("properties", {})
    for name in RESERVED.get(kind, ("use",)):
        if name in properties:
            raise PluginError(f"{who}: option {name!r} has a name that STAR uses itself")
    for name in options.get("required", ()):
        if name not in properties and name not in RESERVED.get(kind, ()):
            raise PluginError(f"{who}: option {name!r} is required but not among its properties")
    for holder in references(options):
        if not _is_there(holder["$ref"], options):
            raise PluginError(f"{who}: options refer to {holder['$ref']!r}, which is not there")
    return replace(offer, options=options)


def held(offer: Offer[Any], given: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """Return the options that say what a step takes hold of outside of STAR, with their values.

    A verb names them in its schema: ``outside: {holds: [port]}``. Two steps at once cannot have the
    same. A step with the option that ``unless`` names there holds nothing.
    """
    known, outside = offer.options.get("properties", {}), offer.options.get("outside", {})
    if outside.get("unless") in given:
        return ()
    return tuple(
        (name, given.get(name, known[name].get("default")))
        for name in outside.get("holds", ())
        if name in known
    )


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


def _plain(who: str, options: Mapping[str, Any], *, trusted: bool) -> dict[str, Any]:
    """Return a copy of a plugin's options as plain JSON."""
    try:
        copy = json.loads(json.dumps(options, default=dict, allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise PluginError(f"{who}: options are no JSON: {error}") from error
    if not trusted:
        _must_be_schema(who, copy)
    if not isinstance(copy, dict) or copy.get("type", "object") != "object":
        raise PluginError(f"{who}: options are no schema of an object, expected type: object")
    return {key: value for key, value in copy.items() if key not in {"$schema", "$id"}}


def _must_be_schema(who: str, options: Any) -> None:
    from jsonschema import Draft202012Validator, SchemaError

    try:
        Draft202012Validator.check_schema(options)
    except SchemaError as error:
        where = ".".join(str(part) for part in ("options", *error.absolute_path))
        raise PluginError(f"{who}: {where} is no JSON Schema: {error.message}") from error
    except RecursionError as error:
        raise PluginError(f"{who}: options are no JSON: {error}") from error


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
