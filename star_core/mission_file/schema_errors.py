"""Turns what a JSON Schema found into one fault for each mistake in a mission or a world.

It knows what a schema does not: that a step has one verb, that an option belongs to a plugin, and
which of several errors are one mistake.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from star_core.errors import suggestion
from star_core.mission_file import error_messages as wording
from star_core.mission_file.error_messages import Breach, show
from star_core.mission_file.located import Location
from star_core.plugin_schema import PARTS

if TYPE_CHECKING:
    from jsonschema import ValidationError


CODES = {
    "type": "wrong-type",
    "required": "missing-option",
    "enum": "invalid-value",
    "const": "invalid-value",
    "pattern": "invalid-value",
    "minimum": "out-of-range",
    "maximum": "out-of-range",
    "exclusiveMinimum": "out-of-range",
    "exclusiveMaximum": "out-of-range",
    "minItems": "wrong-length",
    "maxItems": "wrong-length",
    "minLength": "wrong-length",
    "maxLength": "wrong-length",
    "minProperties": "wrong-length",
    "maxProperties": "wrong-length",
    "uniqueItems": "duplicate-item",
    "dependentRequired": "missing-option",
    "oneOf": "option-conflict",
    "anyOf": "option-conflict",
}
"""Codes of mistakes by the keyword of the schema."""

_CHOICE = ((), ("use",))  # where a plugin's name stands, below its kind
NESTED = (("repeat", "steps"), ("each", "steps"))  # where steps stand inside of a step


class Fault(NamedTuple):
    """One mistake.

    Attributes:
        path: Where it is: keys and indices.
        message: What is wrong and what was expected.
        code: Identifies the kind of mistake.
        key: Whether it is the key that is wrong, or the whole that the key names.
        lacks: Whether the value at `path` only lacks a key.
    """

    path: Location
    message: str
    code: str = "invalid-option"
    key: bool = False
    lacks: bool = False


def explain(errors: Iterable[ValidationError], data: Any) -> Iterator[Fault]:
    """Say what is wrong with `data`, one fault for each mistake."""
    found = [Breach.of(error) for error in errors]
    mistyped = {breach.path for breach in found if breach.keyword == "type"}
    beside = {breach.path: _beside(breach) for breach in found if _is_step(breach.path)}
    for breach in found:
        if beside.get(breach.path):  # whatever else is wrong with this step follows from it
            yield from _misplaced(breach, beside[breach.path])
        elif beside.get(breach.path[:-1]) and (
            breach.value is None or breach.keyword == "required"
        ):
            continue
        elif breach.keyword == "type" or breach.of_key or breach.path not in mistyped:
            yield from _explain(breach, data)


def _explain(breach: Breach, data: Any) -> Iterator[Fault]:
    path, keyword = breach.path, breach.keyword
    if breach.of_key:
        message = f"{show(breach.value)} cannot be a name here: {wording.reason(breach)}"
        yield Fault((*path, breach.value), _about(path, data, message), "invalid-name", key=True)
    elif keyword == "additionalProperties":
        yield from _unknown(breach, data)
    elif keyword == "required":
        for name in breach.wanted:
            if name not in breach.value:
                message = _about(path, data, _missing(name, path))
                yield Fault(path, message, "missing-option", key=True, lacks=True)
    elif (nearest := breach.nearest()) is not None:
        yield from _explain(nearest, data)
    elif keyword == "type" and "errorMessage" in breach.rules:
        whole = path[:-1] if isinstance(path[-1], int) else path  # what is so of every item
        yield Fault(whole, _about(whole, data, breach.rules["errorMessage"]), "wrong-type")
    else:
        message = _own_words(breach)
        code = _own_code(breach) if message else CODES.get(keyword, "invalid-option")
        yield Fault(path, message or _about(path, data, wording.say(breach)), code)


def _own_words(breach: Breach) -> str:
    """Say what is wrong with what only missions have; empty for anything else."""
    path, keyword = breach.path, breach.keyword
    if _is_step(path):
        return _no_step(breach)
    if keyword == "type" and breach.value is None and _is_step(path[:-1]):
        return _empty_verb(breach)
    if keyword == "type" and breach.wanted == "object" and _is_step(path[:-1]):
        return _no_options(breach)
    if keyword in {"enum", "type"} and path[:1] and path[0] in PARTS and path[1:] in _CHOICE:
        return _part(breach)
    if keyword == "const" and path == ("star",):
        return f"this version reads `star: {breach.wanted}`, this file is of {show(breach.value)}"
    return ""


def _own_code(breach: Breach) -> str:
    """Return the code of a mistake in what only missions have."""
    if _is_step(breach.path) or _is_step(breach.path[:-1]):
        return "invalid-step"
    if breach.path == ("star",):
        return "unsupported-version"
    if isinstance(breach.value, str):
        return "unknown-plugin" if breach.keyword == "enum" else "missing-option"
    return "wrong-type"


def _step_in(path: Location) -> Location:
    """Return the path of the innermost step that `path` leads into; empty if there is none."""
    at = 2 if path[:1] == ("mission",) and len(path) > 1 else 0
    while at and len(path) > at + 1:
        if path[at] == "parallel":
            at += 2
        elif path[at : at + 2] in NESTED and len(path) > at + 2:
            at += 3
        else:
            break
    return path[:at]


def _is_step(path: Location) -> bool:
    return bool(path) and _step_in(path) == path


def _about(path: Location, data: Any, message: str) -> str:
    """Put in front of `message` what it is about: ``avoider 'orca': radius: ...``."""
    subject: list[str] = []
    if step := _step_in(path):
        path = path[len(step) :]
        subject, path = [str(name) for name in path[:1]], path[1:]
    elif path and path[0] in PARTS and "use" in data[path[0]]:
        subject, path = [f"{path[0]} {show(data[path[0]]['use'])}"], path[1:]
    dotted = [".".join(str(part) for part in path)] if path else []
    return ": ".join([*subject, *dotted, message])


def _noun(path: Location) -> str:
    return "option" if _step_in(path) or (path and path[0] in PARTS) else "key"


def _missing(name: str, path: Location) -> str:
    if path and path[0] in PARTS and name == "use":
        return "missing key 'use'; write {use: name of a plugin, ...}"
    if not path and name == "star":
        return "missing key 'star'; write `star: 1` first"
    return f"missing {_noun(path)} {name!r}"


def _unknown(breach: Breach, data: Any) -> Iterator[Fault]:
    """Name each key that is not known."""
    path = breach.path
    known = breach.rules.get("properties", {})
    patterns = breach.rules.get("patternProperties", {})
    for key in breach.value:
        if key in known or any(re.search(pattern, key) for pattern in patterns):
            continue
        if _is_step(path):
            verb, colon, _ = key.partition(":")
            split = colon and verb in known
            meant = suggestion(key, known, "expected one of")
            message = (
                f"unknown verb {show(key)}{'; put a blank after the colon' * bool(split) or meant}"
            )
        else:
            message = f"unknown {_noun(path)} {show(key)}{_known(breach, key)}"
            message = _about(path, data, message)
        code = "unknown-verb" if _is_step(path) else "unknown-option"
        yield Fault((*path, key), message, code, key=True)


def _known(breach: Breach, key: str) -> str:
    """Name the key that `key` was perhaps meant for, or every key there is."""
    known = [name for name in breach.rules.get("properties", {}) if name != "use"]
    free = [name for name in known if name not in breach.value]
    if not known:
        return "; there is none"
    return (
        suggestion(key, free) or suggestion(key, known) or f"; expected one of: {', '.join(known)}"
    )


def _verbs(breach: Breach) -> list[str]:
    """Return the known verbs of a step."""
    known = breach.rules.get("properties", {})
    return [key for key in breach.value if key in known] if isinstance(breach.value, dict) else []


def _beside(breach: Breach) -> list[str]:
    """Return the keys of a step that are options of its only verb and should stand inside it."""
    verbs = _verbs(breach)
    if len(verbs) != 1:
        return []
    options = breach.rules["properties"][verbs[0]].get("properties", {})
    others = [key for key in breach.value if key != verbs[0]]
    return others if all(key in options for key in others) else []


def _misplaced(breach: Breach, options: list[str]) -> Iterator[Fault]:
    verb = _verbs(breach)[0]
    for option in options:
        message = f"option {option!r} stands beside its verb {verb!r}; indent it further"
        yield Fault((*breach.path, option), message, "misplaced-key", key=True)


def _no_step(breach: Breach) -> str:
    """Say why something is no step."""
    given, known = breach.value, breach.rules.get("properties", {})
    if given is None:
        return "an empty step, expected a verb such as `land: {}`"
    if given == {}:
        return f"a step has one verb, this one has none{suggestion('', known, 'expected one of')}"
    if isinstance(given, dict):
        named = ", ".join(show(verb) for verb in given)
        return (
            f"a step has one verb, this one has {len(given)}: {named}; write each as its own step"
        )
    if isinstance(given, str) and given in known:
        return f"a step is a map; write it `{given}: {{}}`"
    meant = suggestion(given, known) if isinstance(given, str) else ""
    return f"{wording.what(given)}, expected a step such as `land: {{}}`{meant}"


def _empty_verb(breach: Breach) -> str:
    """Say what should follow a verb."""
    verb = breach.path[-1]
    if breach.wanted == "array":
        return f"{verb}: nothing follows, expected a list of steps"
    needs = ", ".join(f"{name}: ..." for name in breach.rules.get("required", ()))
    return f"{verb}: nothing follows; write it `{verb}: {{{needs}}}`"


def _no_options(breach: Breach) -> str:
    """Say what should follow a verb in place of a single value: the option that it may be for."""
    verb, given = breach.path[-1], breach.value
    example: Mapping[str, Any] = next(iter(breach.rules.get("examples", ())), {})
    option = next(iter(example), "")
    if type(example.get(option)) is type(given):
        example = {option: given}
    said = f"{verb}: {wording.what(given)}, expected a map"
    return f"{said}; write it `{verb}: {written}`" if (written := wording.flow(example)) else said


def _part(breach: Breach) -> str:
    """Say what is wrong with the choice of a plugin."""
    kind, given = breach.path[0], breach.value
    if breach.keyword == "enum" and isinstance(given, str):
        known = suggestion(given, breach.wanted, "installed")
        return f"no {kind} named {show(given)}{known or '; none is installed'}"
    if breach.keyword == "enum":
        return f"{kind}: {wording.what(given)}, expected a name{suggestion('', breach.wanted)}"
    if isinstance(given, str):
        needs = ", ".join(f"{name}: ..." for name in breach.rules.get("required", ()))
        return f"{kind} {given!r} has options that must be given; write {{use: {given}, {needs}}}"
    return f"{kind}: {wording.what(given)}, expected a name or {{use: name, ...}}"
