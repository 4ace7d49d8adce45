"""Turns what a JSON Schema found into one fault for each mistake, in the words of its author.

It knows what a schema does not: that a step has one verb, that an option belongs to a plugin, and
which of several errors are one mistake.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from star_core.commands import PIPELINE_KINDS
from star_core.toolkit import suggestion
from star_yaml.document import Location
from star_yaml.error_messages import (
    CODES,
    Breach,
    general,
    nearest,
    reason,
    short_flow,
    show,
    what,
)

if TYPE_CHECKING:
    from jsonschema import ValidationError

_MEANT: Final = {"agents": "swarm", "drones": "swarm", "robots": "swarm", "steps": "mission"}
_STEPS: Final = {"mission": 2, "on": 4}  # lengths of the paths to steps
_NESTED: Final = (("repeat", "steps"), ("each", "steps"), ("if", "then"), ("if", "else"))
"""Where steps stand inside of a step."""


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
    """Yield what is wrong with `data`, one fault for each mistake."""
    breaches = [Breach.of(error) for error in errors]
    mistyped = {breach.path for breach in breaches if breach.keyword == "type"}
    beside = {breach.path: _beside(breach) for breach in breaches if _is_step(breach.path)}
    for breach in breaches:
        if options := beside.get(breach.path):  # what else is wrong with this step follows from it
            verb = next(key for key in breach.value if key in breach.possible_keys)
            for key in options:
                message = f"option {key!r} stands beside its verb {verb!r}; indent it further"
                yield Fault((*breach.path, key), message, "misplaced-key", key=True)
        elif beside.get(breach.path[:-1]) and (
            breach.value is None or breach.keyword == "required"
        ):
            continue
        elif breach.keyword == "type" or breach.is_key or breach.path not in mistyped:
            yield from _explain(breach, data)


def _explain(breach: Breach, data: Any) -> Iterator[Fault]:
    path, keyword, value = breach.path, breach.keyword, breach.value
    if breach.is_key:
        message = f"{show(value)} cannot be a name here: {reason(breach)}"
        yield Fault((*path, value), _about(path, data, message), "invalid-name", key=True)
    elif keyword == "additionalProperties":
        yield from (_unknown(breach, key, data) for key in _unmatched(breach))
    elif keyword == "required":
        for name in breach.operand:
            if name not in value:
                message = _about(path, data, _missing(name, breach))
                yield Fault(path, message, "missing-option", key=True, lacks=True)
    elif (alternative := nearest(breach)) is not None:
        yield from _explain(alternative, data)
    elif keyword == "type" and "errorMessage" in breach.rules:
        whole = path[:-1] if isinstance(path[-1], int) else path  # what is so of every item
        yield Fault(whole, _about(whole, data, breach.rules["errorMessage"]), "wrong-type")
    elif specific := _specific(breach):
        yield Fault(path, *specific)
    else:
        code = CODES.get(keyword, "invalid-option")
        yield Fault(path, _about(path, data, general(breach), value), code)


# What only missions have


def _step_in(path: Location) -> Location:
    """Return the path of the innermost step that `path` leads into; empty if there is none."""
    at = _STEPS.get(str(path[0]), 0) if path else 0
    at = at if len(path) >= at and path[2:3] != ("when",) else 0
    while at and len(path) > at + 1:
        if path[at] == "parallel":
            at += 2
        elif path[at : at + 2] in _NESTED and len(path) > at + 2:
            at += 3
        else:
            break
    return path[:at]


def _is_step(path: Location) -> bool:
    return bool(path) and _step_in(path) == path


def _about(path: Location, data: Any, message: str, value: Any = None) -> str:
    """Put in front of `message` what it is about: ``avoider 'orca': radius: ...``."""
    subject: list[str] = []
    if step := _step_in(path):
        path = path[len(step) :]
        subject, path = [str(name) for name in path[:1]], path[1:]
    elif path and path[0] in PIPELINE_KINDS and "use" in data[path[0]]:
        subject, path = [f"{path[0]} {show(data[path[0]]['use'])}"], path[1:]
    if path and isinstance(path[-1], int) and not isinstance(value, list | dict):
        path = path[:-1]  # the location shows which item it is
    dotted = [".".join(str(name) for name in path)] if path else []
    return ": ".join([*subject, *dotted, message])


def _noun(path: Location) -> str:
    return "option" if _step_in(path) or (path and path[0] in PIPELINE_KINDS) else "key"


def _missing(name: str, breach: Breach) -> str:
    path = breach.path
    if path and path[0] in PIPELINE_KINDS and name == "use":
        return "missing key 'use'; write {use: name of a plugin, ...}"
    if not path and name == "star":
        return "missing key 'star'; write `star: 1` first"
    installed = (
        breach.possible_keys.get(name, {}).get("examples", ()) if name in PIPELINE_KINDS else ()
    )
    hint = f"; installed: {', '.join(map(str, installed))}" if installed else ""
    return f"missing {_noun(path)} {name!r}{hint}"


def _unmatched(breach: Breach) -> Iterator[str]:
    """Yield the keys that are not known."""
    patterns = breach.rules.get("patternProperties", {})
    for key in breach.value:
        if key not in breach.possible_keys and not any(
            re.search(pattern, key) for pattern in patterns
        ):
            yield key


def _unknown(breach: Breach, key: str, data: Any) -> Fault:
    """Return the fault of a key that is not known."""
    path, possible = breach.path, breach.possible_keys
    word, colon, _ = re.sub(r" *[{\[]", ":", key).partition(":")
    split = f"; put a space after the colon of {word!r}" if key[len(word) :][:1] == ":" else ""
    split = split or f"; put a colon after {word!r}"
    if _is_step(path):
        hint = split if colon and word in possible else suggestion(key, possible, "expected one of")
        return Fault((*path, key), f"unknown verb {show(key)}{hint}", "unknown-verb", key=True)
    names = [name for name in possible if name != "use"]
    free = [name for name in names if name not in breach.value]
    if colon and word in possible:
        hint = split
    elif not path and _MEANT.get(key) in free:
        hint = f"; did you mean {_MEANT[key]!r}?"
    elif not names:
        hint = "; there is none"
    else:
        hint = suggestion(key, free) or suggestion(key, names, "expected one of")
    message = _about(path, data, f"unknown {_noun(path)} {show(key)}{hint}")
    return Fault((*path, key), message, "unknown-option", key=True)


def _beside(breach: Breach) -> list[str]:
    """Return the keys of a step that are options of its only verb and should stand inside it."""
    value, possible = breach.value, breach.possible_keys
    verbs = [key for key in value if key in possible] if isinstance(value, dict) else []
    if len(verbs) != 1:
        return []
    options = possible[verbs[0]].get("properties", {})
    others = [key for key in value if key not in verbs]
    return others if all(key in options for key in others) else []


def _specific(breach: Breach) -> tuple[str, str] | None:
    """Return what is wrong with what only missions have, and its code; None for anything else."""
    path, keyword = breach.path, breach.keyword
    if _is_step(path):
        return _no_step(breach), "invalid-step"
    if keyword == "type" and _is_step(path[:-1]) and breach.value is None:
        return _empty_verb(breach), "invalid-step"
    if keyword == "type" and _is_step(path[:-1]) and breach.operand == "object":
        return _no_options(breach), "invalid-step"
    if (
        keyword in {"enum", "type"}
        and path[:1]
        and path[0] in PIPELINE_KINDS
        and path[1:] in {(), ("use",)}
    ):
        return _choice(breach)
    if keyword == "const" and path == ("star",):
        text = f"this version reads `star: {breach.operand}`, this file is of {show(breach.value)}"
        return text, "unsupported-version"
    return None


def _no_step(breach: Breach) -> str:
    """Return why something is no step."""
    value, possible = breach.value, breach.possible_keys
    if value is None:
        return "an empty step, expected a verb such as `land: {}`"
    if value == {}:
        return (
            f"a step has one verb, this one has none{suggestion('', possible, 'expected one of')}"
        )
    if isinstance(value, dict):
        named = ", ".join(show(verb) for verb in value)
        return (
            f"a step has one verb, this one has {len(value)}: {named}; write each as its own step"
        )
    if isinstance(value, str) and value in possible:
        return f"a step is a map; write it `{value}: {{}}`"
    meant = suggestion(value, possible) if isinstance(value, str) else ""
    return f"{what(value)}, expected a step such as `land: {{}}`{meant}"


def _empty_verb(breach: Breach) -> str:
    """Return what should follow a verb."""
    verb = breach.path[-1]
    if breach.operand == "array":
        return f"{verb}: nothing follows, expected a list of steps"
    needs = ", ".join(f"{name}: ..." for name in breach.rules.get("required", ()))
    return f"{verb}: nothing follows; write it `{verb}: {{{needs}}}`"


def _no_options(breach: Breach) -> str:
    """Return what should follow a verb in place of a value: the option that it may be for."""
    verb, value = breach.path[-1], breach.value
    example: Mapping[str, Any] = next(iter(breach.rules.get("examples", ())), {})
    option = next(iter(example), "")
    if type(example.get(option)) is type(value):
        example = {option: value}
    message = f"{verb}: {what(value)}, expected a map"
    return f"{message}; write it `{verb}: {text}`" if (text := short_flow(example)) else message


def _choice(breach: Breach) -> tuple[str, str]:
    """Return what is wrong with the choice of a plugin, and its code."""
    kind, value = breach.path[0], breach.value
    if breach.keyword == "enum" and isinstance(value, str):
        hint = suggestion(value, breach.operand, "installed") or "; none is installed"
        return f"no {kind} named {show(value)}{hint}", "unknown-plugin"
    if breach.keyword == "enum":
        text = f"{kind}: {what(value)}, expected a name{suggestion('', breach.operand)}"
    elif isinstance(value, str):
        needs = ", ".join(f"{name}: ..." for name in breach.rules.get("required", ()))
        text = f"{kind} {value!r} has options that must be given; write {{use: {value}, {needs}}}"
        return text, "missing-option"
    else:
        text = f"{kind}: {what(value)}, expected a name or {{use: name, ...}}"
    return text, "wrong-type"
