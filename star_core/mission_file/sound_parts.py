"""The content of a mission that its schema accepts, for the checks that go beyond the schema."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final

from star_core.mission_file.located import Location
from star_core.plugin_support.option_schema import PARTS, fill_defaults

if TYPE_CHECKING:
    from star_core.mission_file.schema_errors import Fault

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
            inner = {key: self._without(one, (*path, key)) for key, one in value.items()}
            sound = {key: one for key, one in inner.items() if one is not _REFUSED}
            broken = len(sound) < len(inner) or path in self._lacking
            broken = broken or any(isinstance(one, Incomplete) for one in sound.values())
            return Incomplete(sound) if broken else sound
        if isinstance(value, list):
            items = [self._without(item, (*path, i)) for i, item in enumerate(value)]
            broken = any(item is _REFUSED or isinstance(item, Incomplete) for item in items)
            return _REFUSED if broken else items
        return value


def sound_parts(
    data: Mapping[str, Any], refused: Refused, schema: Mapping[str, Any]
) -> dict[str, Any] | None:
    """Return a mission besides its steps without what its schema refuses, with its defaults.

    Names stay known, so that references to an agent, a group or a camera with a mistake in it are
    no mistakes themselves. The choice of a plugin is a map with the key ``use``.

    Args:
        data: The mission as read.
        refused: What its schema refuses.
        schema: Of missions, for the defaults.

    Returns:
        None if it is not even known which agents there are.
    """

    def named(key: str, unknown: Any) -> dict[str, Any]:
        """Return the values of a map by name; `unknown` for those that are refused."""
        held = data.get(key, {})
        if not isinstance(held, dict):
            return Incomplete()
        sound = {name: refused.without(value, (key, name)) for name, value in held.items()}
        kind = list if isinstance(unknown, list) else dict
        return {name: one if isinstance(one, kind) else unknown for name, one in sound.items()}

    swarm, cameras = named("swarm", Incomplete()), named("cameras", Incomplete())
    if not swarm:
        return None
    for name, camera in cameras.items():
        if "file" in camera:  # which could not be read, or it would have been replaced
            cameras[name] = Incomplete(camera)
    defaulted = ("rate", "seed", "plugin_strikes", "collisions")
    keys = (*PARTS, *defaulted, "limits", "safety", "reserve", "name", "world")
    sound = {key: refused.without(data[key], (key,)) for key in keys if key in data}
    sound = {key: held for key, held in sound.items() if held is not None}
    sound |= {"swarm": swarm, "cameras": cameras, "groups": named("groups", [])}
    for kind in PARTS:
        sound[kind] = _choice(sound.get(kind))
    properties = schema["properties"]
    for key in ("limits", "safety", "reserve"):
        given = sound.get(key, Incomplete() if key in data else {})
        filled = isinstance(given, Incomplete) or (key == "reserve" and not given)
        sound[key] = given if filled else fill_defaults(given, properties[key], schema["$defs"])
    defaults = {key: properties[key]["default"] for key in defaulted}
    return defaults | sound


def _choice(given: Any) -> dict[str, Any]:
    """Return the choice of a plugin, ``name`` or ``{use: name}``, as a map."""
    if isinstance(given, str):
        return {"use": given}
    return given if isinstance(given, dict) and "use" in given else Incomplete(use=UNKNOWN)
