"""Checks of the records that plugins offer: their names, and the JSON Schemas of their options."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, TypeVar
from urllib.parse import unquote

from star_core.errors import ContractError, PluginError
from star_core.plugin_support.specs import MissionSpec, Spec, TaskSpec

AnySpec = TypeVar("AnySpec", bound=Spec)

PIPELINE_KINDS: Final = ("transport", "localizer", "planner", "avoider")
"""Kinds of plugins that a mission chooses, each by name or as ``{use: name, ...options}``."""

SHARED: Final = ("agents", "until", "timeout", "on_failure")
"""Options of every verb beside its own; the core handles them."""

JOIN: Final = "join"
"""Verb before which the core adds agents to the mission."""

LEAVE: Final = "leave"
"""Verb after which the core removes agents from the mission."""

RESERVED: Final = {"task": SHARED}
"""Names that options of a kind must not have; of the other kinds it is ``use``."""

STEP_KEYS: Final = ("parallel", "repeat", "each", "include")
"""Keys of steps that are no verbs."""


def sound(kind: str, offer: AnySpec, *, trusted: bool = False) -> AnySpec:
    """Return a record with its options as plain JSON.

    Args:
        kind: Of the plugin.
        offer: The record.
        trusted: Whether to skip the check that its options are a JSON Schema, which takes a while.

    Raises:
        PluginError: Its name is invalid or used by STAR itself; or its options are not a JSON
            Schema of an object, have a reference without a target, or a name that STAR uses.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_-]*", str(offer.name)):
        raise PluginError(
            f"{kind} {offer.name!r}: a name is lower-case letters, digits, '_' and '-'",
            "contract-broken",
        )
    if kind == "task" and offer.name in STEP_KEYS:
        text = f"{kind} {offer.name!r}: STAR has a {kind} of that name itself"
        raise PluginError(text, "duplicate-plugin")
    if not isinstance(offer, MissionSpec):
        return offer
    try:
        return replace(offer, options=_checked_options(kind, offer, trusted=trusted))
    except ContractError as error:
        raise PluginError(f"{kind} {offer.name!r}: {error}") from error


def _checked_options(kind: str, offer: MissionSpec, *, trusted: bool) -> dict[str, Any]:
    """Return the options of a record as plain JSON, checked; raise `ContractError`."""
    options = _plain(offer.options, trusted=trusted)
    properties = options.setdefault("properties", {})
    reserved = RESERVED.get(kind, ("use",))
    for name in reserved:
        if name in properties:
            raise ContractError(f"option {name!r} has a name that STAR uses itself")
    for name in options.get("required", ()):
        if name not in properties and name not in reserved:
            raise ContractError(f"option {name!r} is required but not among its properties")
    for holder in references(options):
        if not _has_target(holder["$ref"], options):
            raise ContractError(f"options refer to {holder['$ref']!r}, which does not exist")
    for name in _exclusive(offer):
        if name not in properties:
            raise ContractError(f"exclusive names option {name!r}, which does not exist")
    return options


def _exclusive(offer: MissionSpec) -> Iterator[str]:
    """Yield the options named in a task's `Exclusive`."""
    if isinstance(offer, TaskSpec) and offer.exclusive is not None:
        yield from offer.exclusive.options
        if offer.exclusive.unless is not None:
            yield offer.exclusive.unless


def fill_defaults(
    options: Mapping[str, Any],
    schema: Mapping[str, Any],
    definitions: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Any]:
    """Return options with the defaults of their schema, also inside of maps that are given.

    Args:
        options: As given.
        schema: JSON Schema of an object.
        definitions: By name, what ``{$ref: "#/$defs/name"}`` refers to.

    Example:
        >>> fill_defaults({"radius": 0.3}, {"properties": {"radius": {}, "gain": {"default": 2}}})
        {'radius': 0.3, 'gain': 2}
    """
    filled = dict(options)
    for name, written in schema.get("properties", {}).items():
        rules = written if isinstance(written, dict) else {}
        rules = definitions.get(str(rules.get("$ref")).removeprefix("#/$defs/"), rules)
        if name not in filled and "default" in rules:
            filled[name] = deepcopy(rules["default"])
        elif isinstance(filled.get(name), dict):
            filled[name] = fill_defaults(filled[name], rules, definitions)
    return filled


def references(schema: Any) -> Iterator[dict[str, Any]]:
    """Yield every map with a ``$ref`` in a schema."""
    waiting = [schema]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            if isinstance(value.get("$ref"), str):
                yield value
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value


def _plain(options: Mapping[str, Any], *, trusted: bool) -> dict[str, Any]:
    """Return a copy of options as plain JSON; raise `ContractError`."""
    try:
        text = json.dumps(options, default=dict, allow_nan=False)
        if not trusted:
            _require_schema(text)
        copy = json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise ContractError(f"options are not JSON: {error}") from error
    if not isinstance(copy, dict) or copy.get("type", "object") != "object":
        raise ContractError("options are not the schema of an object, expected type: object")
    return {key: value for key, value in copy.items() if key not in {"$schema", "$id"}}


@lru_cache(maxsize=256)  # a registry that is made anew has the plugins of others
def _require_schema(options: str) -> None:
    from jsonschema import Draft202012Validator, SchemaError

    try:
        Draft202012Validator.check_schema(json.loads(options))
    except SchemaError as error:
        path = ".".join(str(key) for key in ("options", *error.absolute_path))
        raise ContractError(f"{path} is not a JSON Schema: {error.message}") from error


def _has_target(reference: str, schema: Any) -> bool:
    """Return whether a JSON pointer (``#/$defs/point``) has a target in a schema."""
    start, *names = unquote(reference).split("/")
    for name in names:
        token = name.replace("~1", "/").replace("~0", "~")
        if isinstance(schema, list) and token.isdecimal() and int(token) < len(schema):
            schema = schema[int(token)]
        elif isinstance(schema, dict) and token in schema:
            schema = schema[token]
        else:
            return False
    return start == "#"
