"""Schemas for editors: with titles and, for missions and steps, with names for values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from star_core import Registry
from star_yaml.schema import PARAMETER

NO_SCHEMAS: Final = ("const", "default", "enum", "examples")
"""Keywords whose values are no schemas, whatever they look like."""

_NAMED: Final = {"$ref": "#/$defs/named_value"}
NAMED_VALUE: Final = {
    "pattern": PARAMETER,
    "patternErrorMessage": "a string here is '$' and a name, or $(...) with arithmetic",
}
_UNNAMED: Final = ("star", "let", "parameters")
"""Keys at the top of a file whose values are written out."""
# keywords under which schemas stand: by name, in a list, and one; `if` and `not` stay as they are
_MAPS: Final = ("properties", "patternProperties", "dependentSchemas", "$defs")
_LISTS: Final = ("allOf", "anyOf", "prefixItems")
_ONE: Final = (
    *("items", "unevaluatedItems", "contains"),
    *("additionalProperties", "unevaluatedProperties", "then", "else"),
)
_OF_STRINGS: Final = (
    *("enum", "enumDescriptions", "const", "pattern", "patternErrorMessage"),
    *("minLength", "maxLength", "format", "not", "if", "then", "else"),
)
"""Rules that the name of a parameter may break."""


def editor_schema(kind: str, registry: Registry) -> dict[str, Any]:
    """Return the JSON Schema of a kind of file for editors, with the options of all plugins."""
    schema = registry.find("file_kind", kind).offer.schema(registry)
    return for_editors(schema, parameters=kind in {"mission", "steps"})


def for_editors(schema: dict[str, Any], *, parameters: bool = False) -> dict[str, Any]:
    """Return a schema with a title for every property.

    Args:
        schema: To be changed in place.
        parameters: Whether a name or an expression may stand for every value.
    """
    _entitle(schema, schema)
    if parameters:
        schema["properties"] = {
            name: rules if name in _UNNAMED else admitting(rules)
            for name, rules in schema["properties"].items()
        }
        definitions = {name: admitting(rules) for name, rules in schema["$defs"].items()}
        schema["$defs"] = {**definitions, "named_value": NAMED_VALUE}
    return schema


def admitting(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Return a schema that lets a parameter replace every value, for editors.

    Every rule stays where it is, so that an editor completes and explains as before, but for those
    that no ``$name`` would keep: they hold for everything else. Alternatives need not exclude each
    other any more: which of them a parameter is for is not known.

    >>> admitting({"title": "Height", "type": "number"})["type"]
    ['number', 'string']
    >>> admitting({"enum": ["land", "hold"]})["else"]
    {'enum': ['land', 'hold']}
    """
    made = {key: _inner(key, rule) for key, rule in schema.items()}
    if branches := made.pop("oneOf", None):
        either = {"anyOf": [admitting(branch) for branch in branches]}
        made["allOf"] = [*made.get("allOf", ()), either]
    strict = {key: made.pop(key) for key in _OF_STRINGS if key in made}
    types = [made["type"]] if isinstance(made.get("type"), str) else made.get("type", [])
    if "enum" in strict:
        made["examples"] = strict["enum"]  # what editors offer where nothing is written yet
    if not types or "string" in types:
        return {**made, "if": {"type": "string", **_NAMED}, "else": strict} if strict else made
    made["type"] = [*types, "string"]
    if strict:
        return {**made, "if": {"type": "string"}, "then": dict(_NAMED), "else": strict}
    return {**made, **_NAMED}


def _inner(key: str, rule: Any) -> Any:
    """Return what stands under a keyword, with the schemas in it made to admit parameters."""
    if key in _MAPS:
        return {
            name: _named_or(inner) if name == "use" else _admitting(inner)
            for name, inner in rule.items()
        }
    if key in _LISTS:
        return [_admitting(inner) for inner in rule]
    return _admitting(rule) if key in _ONE else rule


def _named_or(plugin: Any) -> Any:
    """Return the schema of a plugin's name, as which editors offer all with what they do."""
    if not (isinstance(plugin, dict) and "enum" in plugin):
        return plugin
    strict = {key: plugin[key] for key in _OF_STRINGS if key in plugin}
    described = {key: rule for key, rule in plugin.items() if key not in strict}
    return {**described, "anyOf": [strict, _NAMED], "examples": plugin["enum"]}


def _admitting(schema: Any) -> Any:
    return admitting(schema) if isinstance(schema, dict) else schema  # True is a schema too


def _entitle(value: Any, root: Mapping[str, Any]) -> None:
    """Give every property a title that has none and refers to none: its name in words.

    Editors head the description of a property with its title, or with that of its parent.
    """
    if isinstance(value, list):
        for item in value:
            _entitle(item, root)
    if not isinstance(value, dict):
        return
    for key, inner in value.items():
        if key not in NO_SCHEMAS:
            _entitle(inner, root)
    properties = value.get("properties")
    for name, rules in properties.items() if isinstance(properties, dict) else ():
        if not isinstance(rules, dict) or "title" in rules or "title" in _referred(rules, root):
            continue
        rules["title"] = name.removesuffix("_deg").replace("_", " ").capitalize()


def _referred(schema: Mapping[str, Any], root: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the definition of `root` that a schema refers to; an empty one if there is none."""
    name = str(schema.get("$ref", "")).removeprefix("#/$defs/")
    definition: Mapping[str, Any] = root.get("$defs", {}).get(name, {})
    return definition
