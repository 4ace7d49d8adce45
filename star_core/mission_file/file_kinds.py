"""What a file is, by its keys, and that a command is given the kind of file that it needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, Literal, TypeAlias

from star_core.errors import suggestion
from star_core.mission_file.located import Document
from star_core.plugin_support.option_schema import PARTS

Kind: TypeAlias = Literal[
    "mission", "steps", "world", "camera", "study", "faults", "crazyswarm2", "original STAR"
]

NAMES: Final[Mapping[Kind, str]] = {
    "mission": "a mission",
    "steps": "a file of steps",
    "world": "a world",
    "camera": "a camera",
    "study": "a study",
    "faults": "a file of faults",
    "crazyswarm2": "a file of Crazyswarm2",
    "original STAR": "a file of the original STAR",
}
_OWN: Final[Mapping[Kind, set[str]]] = {  # keys that only these files have
    "mission": {"world", "swarm", "agents", "drones", *PARTS},  # `agents` is meant for `swarm`
    "study": {"missions", "factors", "measures"},
    "faults": {"faults"},
    "world": {"fence", "obstacles", "landmarks", "targets"},
    "camera": {"width", "height", "matrix", "distortion", "position", "exposure", "readout"}
    | {"roll_deg", "pitch_deg", "yaw_deg"},
    "crazyswarm2": {"robots", "robot_types", "fileversion"},
    "original STAR": {"command_sequence", "environment", "april_tags"},
}
_NEEDED: Final = ("world", "swarm", *PARTS)  # what steps lack to be a mission
_IMPORTED: Final = "`star import` turns it into a mission and a world"
_HINTS: Final[Mapping[tuple[Kind, Kind], str]] = {  # by what a file is, and what is expected
    ("steps", "mission"): "name a mission that includes it",
    ("world", "mission"): "name a mission that is flown in it",
    ("camera", "mission"): "name a mission that has it",
    ("study", "mission"): "`star ablate` checks and flies it",
    ("faults", "mission"): "`star run MISSION --faults FILE` injects them",
    ("mission", "study"): "`star run` flies it",
}


def kind_of(data: Mapping[str, Any]) -> Kind:
    """Return what a file is meant to be, by its keys; a mission if it could be anything.

    Steps for missions to include have ``parameters``, however misspelt, or no key of a mission but
    ``mission`` itself.
    """
    keys = set(data)
    if keys & _OWN["faults"]:
        return "faults"
    more = keys - {"star", "name", "mission"}
    if keys & _OWN["mission"]:
        return "mission"
    if any(suggestion(key, ["parameters"]) for key in more) or ("mission" in keys and not more):
        return "steps"
    if "mission" in keys:
        return "mission"
    for kind, own in _OWN.items():
        if keys & own:
            return kind
    kinds: tuple[Kind, ...] = ("world", "camera")
    return next((k for k in kinds if any(suggestion(key, _OWN[k]) for key in more)), "mission")


def require_kind(document: Document, expected: Kind) -> None:
    """Require that a file is not clearly of another kind.

    Raises:
        InputError: It is; states which.
    """
    data, kind = document.data, kind_of(document.data)
    clear = kind == "steps" or not _OWN[kind].isdisjoint(data)
    if kind == expected or (expected != "mission" and not clear):
        return
    hint = _HINTS.get(
        (kind, expected), _IMPORTED if kind in {"crazyswarm2", "original STAR"} else ""
    )
    if (kind, expected) == ("mission", "world") and data.get("world") != document.path.name:
        hint = f"its world is {data.get('world')!r}"
    hint = f"; {hint}" if hint else ""
    hint += lacking(document) if (kind, expected) == ("steps", "mission") else ""
    text = f"this is {NAMES[kind]}, expected {NAMES[expected]}{hint}"
    raise document.root.wrong(text, "wrong-file")


def lacking(document: Document) -> str:
    """Return what a file of steps without parameters lacks if it is meant to be a mission."""
    missing = [key for key in _NEEDED if key not in document.data]
    lacks = f"; as a mission it lacks {', '.join(missing)}"
    return "" if "parameters" in document.data else lacks
