"""Turns what a JSON Schema found into one fault for each mistake, in the words of its author.

It knows what a schema does not: that a step has one verb, that an option belongs to a plugin, and
which of several errors are one mistake.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from star_core.commands import PIPELINE_KINDS, blocked_hint
from star_core.toolkit import suggestion
from star_yaml.document import Location
from star_yaml.error_messages import CODES, Breach, hint_to_write, message, show, what

if TYPE_CHECKING:
    from jsonschema import ValidationError

_SYNONYMS: Final = {"agents": "swarm", "drones": "swarm", "robots": "swarm", "steps": "mission"}
"""Names that other software has for keys of a mission."""
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
    breaches = [Breach(error) for error in errors]
    mistyped = {breach.path for breach in breaches if breach.keyword == "type"}
    beside = {breach.path: _beside(breach) for breach in breaches if _is_step(breach.path)}
    for breach in breaches:
        if options := beside.get(breach.path):  # what else is wrong with this step follows from it
            verb = next(key for key in breach.value if key in breach.properties)
            for key in options:
                text = f"option {key!r} stands beside its verb {verb!r}; indent it further"
                yield Fault((*breach.path, key), text, "misplaced-key", key=True)
        elif beside.get(breach.path[:-1]) and (
            breach.value is None or breach.keyword == "required"
        ):
            continue
        elif breach.keyword == "type" or breach.is_key or breach.path not in mistyped:
            yield from _explain(breach, data)


def _explain(breach: Breach, data: Any) -> Iterator[Fault]:
    path, keyword, value = breach.path, breach.keyword, breach.value
    if breach.is_key:
        text = f"{show(value)} cannot be a name here: {breach.reason}"
        yield Fault((*path, value), _about(path, data, text), "invalid-name", key=True)
    elif keyword == "additionalProperties":
        patterns = breach.rules.get("patternProperties", {})
        for key in value:
            if key not in breach.properties and not any(re.search(p, key) for p in patterns):
                yield _unknown(breach, key, data)
    elif keyword == "required":
        for name in breach.operand:
            if name not in value:
                text = _about(path, data, _missing(name, breach))
                yield Fault(path, text, "missing-option", key=True, lacks=True)
    elif specific := _specific(breach):
        yield Fault(path, *specific)
    else:
        if keyword == "type" and "errorMessage" in breach.rules and isinstance(path[-1], int):
            path = path[:-1]  # what is so of every item
        text = _about(path, data, message(breach), value)
        yield Fault(path, text, CODES.get(keyword, "invalid-option"))


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


def _about(path: Location, data: Any, text: str, value: Any = None) -> str:
    """Put in front of `text` what it is about: ``avoider 'orca': radius: ...``."""
    subject: list[str] = []
    if step := _step_in(path):
        path = path[len(step) :]
        subject, path = [str(name) for name in path[:1]], path[1:]
    elif path and path[0] in PIPELINE_KINDS and "use" in data[path[0]]:
        subject, path = [f"{path[0]} {show(data[path[0]]['use'])}"], path[1:]
    if path and isinstance(path[-1], int) and not isinstance(value, list | dict):
        path = path[:-1]  # the location shows which item it is
    dotted = [".".join(str(name) for name in path)] if path else []
    return ": ".join([*subject, *dotted, text])


def _noun(path: Location) -> str:
    if _is_step(path):
        return "verb"
    return "option" if _step_in(path) or (path and path[0] in PIPELINE_KINDS) else "key"


def _missing(name: str, breach: Breach) -> str:
    hint = ""
    if name in PIPELINE_KINDS:
        hint = f"; installed: {', '.join(breach.properties[name]['examples'])}"
    elif (name, breach.path) == ("star", ()):
        hint = "; write `star: 1` first"
    return f"missing {_noun(breach.path)} {name!r}{hint}"


def _unknown(breach: Breach, key: str, data: Any) -> Fault:
    """Return the fault of a key that is not known."""
    names = [name for name in breach.properties if name != "use"]
    word = re.split(r":| *[\[{]", key)[0]
    free = [name for name in names if name not in breach.value]
    if word != key and word in names:
        hint = f"; write `{word}: ...`, with a colon and a space"
    elif not breach.path and _SYNONYMS.get(key) in free:
        hint = f"; did you mean {_SYNONYMS[key]!r}?"
    else:
        hint = suggestion(key, free) or suggestion(key, names, "expected one of")
    noun = _noun(breach.path)
    if noun == "verb":
        hint = blocked_hint(word) or hint
    text = _about(breach.path, data, f"unknown {noun} {show(key)}{hint}")
    code = "unknown-verb" if noun == "verb" else "unknown-option"
    return Fault((*breach.path, key), text, code, key=True)


def _beside(breach: Breach) -> list[str]:
    """Return the keys of a step that are options of its only verb and should stand inside it."""
    value, possible = breach.value, breach.properties
    verbs = [key for key in value if key in possible] if isinstance(value, dict) else []
    if len(verbs) != 1:
        return []
    options = possible[verbs[0]].get("properties", {})
    others = [key for key in value if key not in verbs]
    return others if all(key in options for key in others) else []


def _specific(breach: Breach) -> tuple[str, str] | None:
    """Return what is wrong with what only missions have, and its code; None for anything else."""
    path, keyword, value = breach.path, breach.keyword, breach.value
    if _is_step(path):
        return _no_step(value), "invalid-step"
    if keyword == "type" and _is_step(path[:-1]) and (value is None or breach.operand == "object"):
        return _no_options(breach), "invalid-step"
    if keyword in {"enum", "type"} and path[:1] and path[0] in PIPELINE_KINDS:
        return _choice(breach) if path[1:] in {(), ("use",)} else None
    if keyword == "const" and path == ("star",):
        text = f"this version reads `star: {breach.operand}`, this file is of {show(value)}"
        return text, "unsupported-version"
    return None


def _no_step(value: Any) -> str:
    """Return why something is no step."""
    if not isinstance(value, dict):
        return f"{what(value)}, expected a step such as `land: {{}}`"
    verbs = f"{len(value)}: {', '.join(map(show, value))}" if value else "none"
    return f"a step has one verb, this one has {verbs}; write each as its own step"


def _no_options(breach: Breach) -> str:
    """Return what should follow a verb in place of a value: the option that it may be for."""
    verb, value = breach.path[-1], breach.value
    if breach.operand == "array":
        return f"{verb}: {what(value)}, expected a list of steps"
    needs = dict.fromkeys(breach.rules.get("required", ()), "...")
    example: Mapping[str, Any] = next(iter(breach.rules.get("examples", ())), needs)
    option = next(iter(example), "")
    if option and type(example[option]) is type(value):
        example = {option: value}
    return f"{verb}: {what(value)}, expected a map{hint_to_write(example, f'{verb}: ')}"


def _choice(breach: Breach) -> tuple[str, str]:
    """Return what is wrong with the choice of a plugin, and its code."""
    kind, value = breach.path[0], breach.value
    if not isinstance(value, str):
        return f"{kind}: {what(value)}, expected a name or {{use: name, ...}}", "wrong-type"
    if breach.keyword == "enum":
        hint = suggestion(value, breach.operand, "installed") or "; none is installed"
        hint = blocked_hint(value) or hint
        return f"no {kind} named {show(value)}{hint}", "unknown-plugin"
    needs = ", ".join(f"{name}: ..." for name in breach.rules.get("required", ()))
    text = f"{kind} {value!r} has options that must be given"
    return f"{text}; write {{use: {value}, {needs}}}", "missing-option"
