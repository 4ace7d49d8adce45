"""Describes one plugin: its options with allowed values, ranges, defaults and nested keys."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any, Final

from star_basics.columns import text_width
from star_basics.list_plugins import options_of
from star_core import TaskSpec
from star_core.commands import PIPELINE_KINDS, SHARED, Found
from star_core.toolkit import flow

MAX_DEPTH: Final = 4  # levels of maps inside options that are described
AGENTS: Final = {"ground": "on the ground", "air": "in the air"}


def describe(kind: str, plugin: Found) -> str:
    """Return the description of one plugin."""
    offer, schema = plugin.offer, options_of(plugin)
    lines = [
        f"{offer.name}: {kind.replace('_', ' ')} of {plugin.source}",
        *_wrapped(offer.summary, 2),
    ]
    if isinstance(offer, TaskSpec) and offer.before:
        lines += _wrapped(f"Its agents must be {AGENTS[offer.before]} when it begins.", 2)
    properties = schema.get("properties", {})
    if properties:
        lines += ["", "  Options:", *_options(schema, schema.get("$defs", {}))]
    if usage := _usage(kind, plugin):
        lines += ["", *_wrapped(usage, 2)]
    return "\n".join(lines)


def _usage(kind: str, plugin: Found) -> str:
    name, schema = plugin.offer.name, options_of(plugin)
    if kind == "command":
        return f"`star {name} --help` describes its options."
    if kind == "run_option":
        value = f" {plugin.offer.metavar}" if plugin.offer.metavar else ""
        return f"Example: star run MISSION --{name}{value}"
    required = dict.fromkeys(schema.get("required", ()), "...")
    if kind == "task":
        example = flow(next(iter(schema.get("examples", ())), required))
        return f"Example: - {name}: {example}. All verbs also have: {', '.join(SHARED)}."
    if kind in PIPELINE_KINDS:
        defaults = {key: rules["default"] for key, rules in schema.get("properties", {}).items()
                 if isinstance(rules, dict) and rules.get("default") is not None}  # fmt: skip
        some = required or dict(list(defaults.items())[:1])
        return f"Example: {kind}: {flow({'use': name} | some) if some else name}"
    return ""


def _options(
    schema: Mapping[str, Any], shared: Mapping[str, Any], above: str = ""
) -> Iterator[str]:
    """Yield the lines of all options of a schema; keys of maps as ``camera.latency``."""
    for key, written in schema.get("properties", {}).items():
        name, rules = above + key, resolved(written, shared)
        facts = [allowed(rules, shared)]
        if "default" in rules:
            facts.append(f"default {flow(rules['default'])}")
        if key in schema.get("required", ()):
            facts.append("required")
        yield from _wrapped(f"{name}: {'; '.join(filter(None, facts))}", 4, 4)
        yield from _wrapped(rules.get("description", ""), 8)
        if name.count(".") == MAX_DEPTH:  # a schema may refer to itself
            continue
        inside = rules if "properties" in rules else resolved(rules.get("items"), shared)
        yield from _options(inside, shared, f"{name}.")


def resolved(written: Any, shared: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a schema that may be a reference into `shared`; True and False are schemas too."""
    if not isinstance(written, dict):
        return {}
    reference = str(written.get("$ref", "")).removeprefix("#/$defs/")
    return {**shared.get(reference, {}), **written}


def allowed(rules: Mapping[str, Any], shared: Mapping[str, Any]) -> str:
    """Return which values a schema allows: ``number from 0 to 1``, ``hold | fail``.

    >>> allowed({"type": ["number", "null"], "exclusiveMinimum": 0}, {})
    'number > 0, or null'
    >>> point = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
    >>> allowed({"type": "array", "items": point, "minItems": 1}, {})
    'list of at least 1 list of 3 numbers'
    """
    if "enum" in rules:
        return " | ".join(map(flow, rules["enum"]))
    if "const" in rules:
        return flow(rules["const"])
    if several := rules.get("anyOf", rules.get("oneOf")):
        return ", or ".join(allowed(resolved(alternative, shared), {}) for alternative in several)
    types = rules.get("type", ())
    names = [types] if isinstance(types, str) else types
    return ", or ".join(_of_type(name, rules, shared) for name in names)


def _of_type(name: str, rules: Mapping[str, Any], shared: Mapping[str, Any]) -> str:
    match name:
        case "number" | "integer":
            return f"{name}{_range(rules)}"
        case "boolean":
            return "true | false"
        case "array":
            return f"list of {_items(rules, allowed(resolved(rules.get('items'), shared), {}))}"
        case "object":
            values = rules.get("additionalProperties")
            if "properties" in rules or not isinstance(values, dict):
                return "map"
            kind = allowed(resolved(values, shared), {})
            return f"map of names to {kind if kind.endswith('s') else f'{kind}s'}"
        case _:
            return name


def _range(rules: Mapping[str, Any]) -> str:
    low, high = rules.get("minimum"), rules.get("maximum")
    above, below = rules.get("exclusiveMinimum"), rules.get("exclusiveMaximum")
    if low is not None and high is not None:
        return f" from {low} to {high}"
    limits = ((">", above), ("≥", low), ("<", below), ("≤", high))
    return "".join(
        f"{' and' * bool(i)} {sign} {limit}"
        for i, (sign, limit) in enumerate(bound for bound in limits if bound[1] is not None)
    )


def _items(rules: Mapping[str, Any], item: str) -> str:
    """Return how many of which items a list has, without the items' ranges."""
    low, high = rules.get("minItems"), rules.get("maxItems")
    count = f"{low} " if low and low == high else f"at least {low} " if low else ""
    word, _, rest = item.partition(" ")
    if not word.isalpha() or rest.startswith("|"):
        return f"{count}values" + f" ({item})" * bool(item)
    rest = "" if word in {"number", "integer"} else f" {rest}".rstrip()
    return f"{count}{word}{'s' * (low != 1)}{rest}"


def _wrapped(text: str, indent: int, hang: int = 0) -> list[str]:
    return textwrap.wrap(
        text,
        text_width(),
        initial_indent=" " * indent,
        subsequent_indent=" " * (indent + hang),
        break_on_hyphens=False,
    )
