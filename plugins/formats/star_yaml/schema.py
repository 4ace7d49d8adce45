"""The schemas of every file: composed from what is installed, and checked with places."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote, unquote

from star_core import InputError, Problem, Registry
from star_core.commands import PIPELINE_KINDS, SHARED
from star_core.formats import MissionSpec, references
from star_yaml.document import Document, Location
from star_yaml.input_file import read, require_kind

if TYPE_CHECKING:
    from jsonschema import ValidationError
    from jsonschema.protocols import Validator

    from star_yaml.schema_errors import Fault

SIGN: Final = "$"
"""Begins a string that names a value: a parameter of a file, or one of ``let``."""

PARAMETER: Final = r"^\$."
"""The pattern of strings that name a value or are an expression."""

_CONTAINERS: Final = ("anyOf", "oneOf", "contains")
"""Rules that a list or a map may break for what it holds."""


def load(name: str) -> dict[str, Any]:
    """Read ``schemas/<name>.schema.json``, as for ``world``."""
    packaged = Path(__file__).with_name("schemas")
    folder = packaged if packaged.is_dir() else Path(__file__).parents[3] / "schemas"
    schema: dict[str, Any] = json.loads(
        (folder / f"{name}.schema.json").read_text(encoding="utf-8")
    )
    if name == "mission":
        schema["$defs"]["camera"]["properties"] |= _of_camera()
    return schema


def mission_schema(registry: Registry) -> dict[str, Any]:
    """Return the schema of missions with the plugins of a registry."""
    return compose(registry.offers())


def steps_schema(registry: Registry) -> dict[str, Any]:
    """Return the schema of files of steps with the verbs of a registry."""
    return compose_steps(registry.offers())


def world_schema(_registry: Registry) -> dict[str, Any]:
    """Return the schema of worlds, whatever is installed."""
    return load("world")


def camera_schema(_registry: Registry) -> dict[str, Any]:
    """Return the schema of cameras, whatever is installed."""
    return load("camera")


def read_as(path: Path, kind: str, registry: Registry) -> Document:
    """Read the YAML file at `path` and require that it fits the schema of its kind.

    Args:
        path: The file.
        kind: Name of a `FileKindSpec` with a schema.
        registry: Registry of the file kinds.

    Raises:
        InputError: It cannot be read, is of another kind or does not fit the schema; lists every
            reason with its location.
    """
    schema = registry.find("file_kind", kind).offer.schema(registry)
    return read_fitting(path, kind, schema, registry)


def read_fitting(path: Path, kind: str, schema: Mapping[str, Any], registry: Registry) -> Document:
    """Read a file as `read_as` does, for another schema than that of its kind."""
    document = read(path)
    require_kind(document, kind, registry)
    if errors := problems(document, schema):
        raise InputError(errors)
    return document


def compose(offers: Mapping[str, Mapping[str, MissionSpec]]) -> dict[str, Any]:
    """Return the mission schema with the names, options and verbs of these plugins.

    It has neither ``anyOf`` nor ``oneOf`` of its own, so that one mistake is one error and an
    editor completes what fits.

    Args:
        offers: By kind and name, each one `sound`; kinds that a mission file does not name are
            passed over.
    """
    mission = load("mission")
    definitions = mission["$defs"]
    for kind in PIPELINE_KINDS:
        made = {
            name: _options(kind, offer, definitions)
            for name, offer in sorted(offers.get(kind, {}).items())
        }
        mission["properties"][kind] = {
            "title": kind.capitalize(),
            "description": mission["properties"][kind]["description"],
            **_part(made),
        }
    _put_verbs(definitions, offers)
    return mission


def compose_steps(offers: Mapping[str, Mapping[str, MissionSpec]]) -> dict[str, Any]:
    """Return the schema of files of steps, whose steps are those of `compose`."""
    steps, definitions = load("steps"), load("mission")["$defs"]
    _put_verbs(definitions, offers)
    steps["$defs"] = _referred_to(steps["properties"], definitions)
    return steps


def problems(
    document: Document, schema: Mapping[str, Any], *, parameters: bool = False
) -> list[str]:
    """Return every mistake in `document` as one line with its location, in the order of the file.

    The list is empty if there is none.

    Args:
        document: To be held to the schema.
        schema: To hold it to.
        parameters: Whether ``$name`` stands for a value that is not known yet; what depends on it
            is no mistake.
    """
    return located(document, faults(document, schema, parameters=parameters))


def faults(
    document: Document, schema: Mapping[str, Any], *, parameters: bool = False
) -> list[Fault]:
    """Return every mistake in `document`; the arguments are those of `problems`."""
    errors = list(validator()(dict(schema)).iter_errors(document.data))
    if parameters:
        errors = [error for error in errors if not _depends(error)]
    if not errors:
        return []
    from star_yaml.schema_errors import explain

    return list(explain(errors, document.data))


def located(document: Document, faults: Iterable[Fault]) -> list[str]:
    """Return mistakes as one line each with its location, in the order of the file."""
    return document.in_order(
        document.problem(fault.path, fault.message, fault.code, key=fault.key) for fault in faults
    )


def choice_problems(
    kind: str, choice: str | Mapping[str, Any], registry: Registry
) -> Iterator[Problem]:
    """Yield what is wrong with the choice of a plugin; paths begin at the choice."""
    from star_yaml.schema_errors import explain

    mission = compose({kind: registry.offers()[kind]})
    schema = {"properties": {kind: mission["properties"][kind]}, "$defs": mission["$defs"]}
    data = {kind: choice if isinstance(choice, str) else dict(choice)}
    for fault in explain(validator()(schema).iter_errors(data), data):
        yield Problem(tuple(fault.path[1:]), fault.message, fault.code)


UNKNOWN: Final = ""
"""The verb of a step, or the name of a plugin, that cannot be interpreted."""

_REFUSED: Final = object()


class Incomplete(dict[str, Any]):
    """A map without the values that its schema refuses; checks that depend on those skip it."""


class Refused:
    """The paths of a document that its schema refuses.

    Args:
        faults: What the schema finds.
    """

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._paths, self._lacking = set[Location](), set[Location]()
        for fault in faults:
            (self._lacking if fault.lacks else self._paths).add(fault.path)
        # an agent whose name is refused is known all the same
        self._paths = {path for path in self._paths if path[:1] + path[2:] != ("swarm",)}

    def __contains__(self, path: Location) -> bool:
        return path in self._paths

    def without(self, value: Any, path: Location) -> Any:
        """Return the value at a path without what is refused in it.

        A map from which something was removed is `Incomplete`, and so are those around it. A value
        that is refused itself, and a list with a refused item, are returned as None.
        """
        sound = self._without(value, path)
        return None if sound is _REFUSED else sound

    def _without(self, value: Any, path: Location) -> Any:
        if path in self._paths:
            return _REFUSED
        if isinstance(value, dict):
            inner = {key: self._without(item, (*path, key)) for key, item in value.items()}
            sound = {key: item for key, item in inner.items() if item is not _REFUSED}
            broken = len(sound) < len(inner) or path in self._lacking
            broken = broken or any(isinstance(item, Incomplete) for item in sound.values())
            return Incomplete(sound) if broken else sound
        if isinstance(value, list):
            items = [self._without(item, (*path, i)) for i, item in enumerate(value)]
            broken = any(item is _REFUSED or isinstance(item, Incomplete) for item in items)
            return _REFUSED if broken else items
        return value


def is_parameter(value: Any) -> bool:
    """Whether a value is another one's name, or an expression.

    >>> is_parameter("$height"), is_parameter("height"), is_parameter("$"), is_parameter(1)
    (True, False, False, False)
    """
    return isinstance(value, str) and re.match(PARAMETER, value) is not None


def _depends(error: ValidationError) -> bool:
    """Whether it takes the values of parameters to know if this is a mistake."""
    inside = _within(error.instance) if error.validator in _CONTAINERS else ()
    return any(map(is_parameter, (error.instance, *inside)))


def _within(value: Any) -> Iterator[Any]:
    """Yield every value in a list or a map, and in those."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    for item in inner:
        yield item
        yield from _within(item)


def _of_camera() -> dict[str, Any]:
    """Return what a camera has, be it in a mission or in a file of its own."""
    properties: dict[str, Any] = load("camera")["properties"]
    return {name: rules for name, rules in properties.items() if name not in {"star", "name"}}


@cache
def validator() -> type[Validator]:
    """JSON Schema 2020-12, but 2.0 is not a whole number and ``$`` is the very end of a string.

    A plugin that asks for a whole number is given an ``int``; a name that ends in a line break is
    no name of a folder.
    """
    from jsonschema import Draft202012Validator, ValidationError
    from jsonschema.validators import extend

    def is_whole(_checker: object, value: object) -> bool:
        return isinstance(value, int) and not isinstance(value, bool)

    def pattern(
        _validator: object, expression: str, value: object, _schema: object
    ) -> Iterator[Any]:
        to_the_end = re.sub(r"(?<!\\)((?:\\\\)*)\$$", r"\1\\Z", expression)
        if isinstance(value, str) and not re.search(to_the_end, value):
            yield ValidationError(f"{value!r} does not match {expression!r}")

    checker = Draft202012Validator.TYPE_CHECKER.redefine("integer", is_whole)
    return extend(Draft202012Validator, {"pattern": pattern}, type_checker=checker)  # type: ignore[no-any-return, no-untyped-call]


def _put_verbs(
    definitions: dict[str, Any], offers: Mapping[str, Mapping[str, MissionSpec]]
) -> None:
    """Close the definition of a step over the verbs of these plugins."""
    step = definitions["step"]
    step["additionalProperties"] = False
    for verb, offer in sorted(offers.get("task", {}).items()):
        options = _options("task", offer, definitions)
        shared = {name: {"$ref": f"#/$defs/{name}"} for name in SHARED}
        step["properties"][verb] = {**options, "properties": options["properties"] | shared}


def _referred_to(schema: Any, definitions: Mapping[str, Any]) -> dict[str, Any]:
    """Return those definitions that a schema refers to, itself or by way of others."""
    referred: dict[str, Any] = {}
    waiting = [schema]
    while waiting:
        for holder in references(waiting.pop()):
            name = unquote(holder["$ref"].split("/")[2])
            if name not in referred:
                referred[name] = definitions[name]
                waiting.append(referred[name])
    return referred


def _part(made: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the schema of the choice of a plugin: a name, or ``{use: name, ...options}``."""
    summaries = [options["description"] for options in made.values()]
    names = {"enum": list(made), "enumDescriptions": summaries}
    rules: list[Any] = []
    for name, options in made.items():
        used = {
            "type": "object",
            "required": ["use"],
            "properties": {"use": {"const": name}},
        }
        with_use = {**options, "properties": {"use": True, **options["properties"]}}
        rules.append({"if": used, "then": with_use})
        if options.get("required"):
            needs = {"type": "object", "required": options["required"]}
            rules.append({"if": {"const": name}, "then": needs})
    return {
        "type": ["string", "object"],
        "examples": list(made),  # what editors offer where nothing is written yet
        "if": {"type": "string"},
        "then": names,
        "else": {
            "required": ["use"],
            "properties": {"use": {"description": "The plugin's name.", **names}},
        },
        "allOf": rules or [True],
    }


def _options(kind: str, offer: MissionSpec, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return a plugin's options as a closed schema that can stand inside another one.

    What they refer to within themselves is put into `definitions`, and the references are turned.
    """
    options = json.loads(json.dumps(offer.options))  # a copy, as quickly as one is made
    options.setdefault("properties", {})
    home = f"{kind}.{offer.name}"
    for holder in list(references(options)):
        definitions[home] = options
        holder["$ref"] = f"#/$defs/{quote(home)}{holder['$ref'][1:]}"
    return {
        **options,
        "title": offer.name,
        "description": offer.summary,
        "type": "object",
        "additionalProperties": False,
    }
