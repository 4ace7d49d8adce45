"""The parts of a mission that its schema accepts, for the checks that go beyond the schema."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final

from star_core.mission_file.located import Location
from star_core.plugin_schema import PARTS

if TYPE_CHECKING:
    from star_core.mission_file.schema_errors import Fault

UNKNOWN: Final = ""
"""The verb of a step that cannot be interpreted."""

_NESTING: Final = ("repeat", "each")
_REFUSED: Final = object()


class Incomplete(dict[str, Any]):
    """A map without the values that its schema refuses; checks that depend on those skip it."""


def sound_parts(data: Mapping[str, Any], faults: Iterable[Fault]) -> dict[str, Any] | None:
    """Return a mission without what its schema refuses, in a form that every check can traverse.

    Names stay known, so that references to an agent, a group or a camera with a mistake in it are
    no mistakes themselves. Steps keep their indices: one that cannot be interpreted has the verb
    `UNKNOWN`. A map from which something was removed is `Incomplete`, and so are those around it.

    Args:
        data: The mission as read.
        faults: What its schema refuses.

    Returns:
        None if it is not even known which agents there are.
    """
    return _Sieve(data, faults).mission()


class _Sieve:
    def __init__(self, data: Mapping[str, Any], faults: Iterable[Fault]) -> None:
        self._data = data
        self._groups_unknown = not isinstance(data.get("groups", {}), dict)
        self._refused, self._lacking = set[Location](), set[Location]()
        for fault in faults:
            (self._lacking if fault.lacks else self._refused).add(fault.path)

    def mission(self) -> dict[str, Any] | None:
        sound = {key: self._sound(held, (key,)) for key, held in self._data.items()}
        sound = {key: held for key, held in sound.items() if held is not _REFUSED}
        swarm = self._named("swarm", Incomplete())
        if not swarm:
            return None
        cameras = self._named("cameras", Incomplete())
        for name, camera in cameras.items():
            if "file" in camera:  # which could not be read, or it would have been replaced
                cameras[name] = Incomplete(camera)
        groups = self._named("groups", [])
        uncertain = {name for name, held in groups.items() if not held or {*held} - {*swarm}}
        known = {*swarm, *groups, "all"} - uncertain
        sound |= {"swarm": swarm, "cameras": cameras, "groups": groups}
        for key in {"limits", "safety", "reserve"} & {*self._data} - {*sound}:
            sound[key] = Incomplete()
        for kind in PARTS:
            sound[kind] = self._part(kind, sound.get(kind))
        sound["mission"] = self._steps(self._data.get("mission"), ("mission",), known)
        return sound

    def _named(self, key: str, unknown: Any) -> dict[str, Any]:
        """Return the values of a map by name; `unknown` for those that are refused."""
        held = self._data.get(key, {})
        if not isinstance(held, dict):
            return Incomplete()
        sound = {name: self._sound(value, (key, name)) for name, value in held.items()}
        kind = type(unknown)
        return {
            name: value if isinstance(value, kind if kind is list else dict) else unknown
            for name, value in sound.items()
        }

    def _part(self, kind: str, sound: Any) -> str | dict[str, Any]:
        """Return the choice of a plugin; one without a name if that is not known."""
        whole = isinstance(sound, str) or (isinstance(sound, dict) and "use" in sound)
        return sound if whole else Incomplete(use=UNKNOWN)

    def _steps(self, given: Any, path: Location, known: set[str]) -> list[dict[str, Any]]:
        if not isinstance(given, list) or path in self._refused:
            return []
        return [self._step(step, (*path, i), known) for i, step in enumerate(given)]

    def _step(self, step: Any, path: Location, known: set[str]) -> dict[str, Any]:
        legible = isinstance(step, dict) and path not in self._refused
        verbs = [verb for verb in step if (*path, verb) not in self._refused] if legible else []
        if len(verbs) == 1:
            verb = verbs[0]
            given = self._given(verb, step[verb], (*path, verb), known)
            if isinstance(given, dict) and len(step) > 1:
                given = Incomplete({"agents": [], **given})
            if given is not None:
                return {verb: given}
        return {UNKNOWN: Incomplete(agents=[])}

    def _given(self, verb: str, given: Any, path: Location, known: set[str]) -> Any:
        """Return what a verb is given; None if the step cannot be interpreted."""
        if verb == "parallel":
            return self._steps(given, path, known) or None
        if not isinstance(given, dict) or verb == "include":
            return None
        inner = [] if verb not in _NESTING else ["steps"]
        options = self._map({key: held for key, held in given.items() if key not in inner}, path)
        if isinstance(options.get("until"), Incomplete):
            del options["until"]
        if verb != "repeat" and (isinstance(options, Incomplete) or not _names(options) <= known):
            options = Incomplete({"agents": [], **options})
            if self._groups_unknown and not _names(options) <= known:
                options["agents"] = []
        if inner:
            steps = self._steps(given.get("steps"), (*path, "steps"), known)
            options = type(options)({"times": 1} | options | {"steps": steps})
            return options if steps else None
        return options

    def _sound(self, value: Any, path: Location) -> Any:
        """Return a value without what is refused in it, or `_REFUSED`."""
        if path in self._refused and path[:1] + path[2:] != ("swarm",):
            return _REFUSED
        if isinstance(value, dict):
            return self._map(value, path)
        if isinstance(value, list):
            items = [self._sound(item, (*path, i)) for i, item in enumerate(value)]
            broken = any(item is _REFUSED or isinstance(item, Incomplete) for item in items)
            return _REFUSED if broken else items
        return value

    def _map(self, given: Mapping[str, Any], path: Location) -> dict[str, Any]:
        inner = {key: self._sound(value, (*path, key)) for key, value in given.items()}
        sound = {key: value for key, value in inner.items() if value is not _REFUSED}
        broken = len(sound) < len(inner) or path in self._lacking
        broken = broken or any(isinstance(value, Incomplete) for value in sound.values())
        return Incomplete(sound) if broken else sound


def _names(options: Mapping[str, Any]) -> set[str]:
    """Return the agents and groups that a step names."""
    given = options.get("agents", "all")
    return {given} if isinstance(given, str) else {*given}
