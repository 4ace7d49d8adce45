"""Messages from the other process, one JSON object per line, and their validation.

    {"goals": {"cf1": {"position": [x, y, z]}}}    goals; agents not listed keep theirs
    {"done": true}                                 the step succeeded
    {"fail": "why"}                                the step failed

A goal has a ``position``, m in the map, and may have a ``velocity`` (of the goal, m/s), a ``yaw``
(rad) and a ``speed`` (maximum on the way, m/s). Does not import numpy.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, Final, NoReturn

from star_external.goals import checked
from star_external.planner import Answer, Done, Failed
from star_external.text import listed, quoted, reason, refuse

if TYPE_CHECKING:
    from star_core import Scene

KEYS: Final = ("goals", "done", "fail")


def read(line: bytes, scene: Scene, names: Collection[str]) -> Answer:
    """Return the content of a line: goals by agent, success or failure of the step.

    Args:
        line: One line.
        scene: Fence, obstacles and limits, which goals must respect.
        names: Agents that goals may be for.

    Raises:
        InputError: The line is invalid, or one of its goals cannot be flown to.

    Example:
        >>> from star_core.testing import scene
        >>> read(b'{"fail": "no way"}', scene(1), ["cf1"])
        Failed(why='no way')
    """
    content = _json(line)
    if not isinstance(content, dict) or len(content) != 1 or next(iter(content)) not in KEYS:
        refuse(f"expected an object with one of {listed(KEYS)}, got {quoted(content)}")
    ((key, given),) = content.items()
    if key == "done":
        if given is not True:
            refuse(f"done is {quoted(given)}, expected true")
        return Done()
    if key == "fail":
        if not isinstance(given, str):
            refuse(f"fail is {quoted(given)}, expected the reason as a string")
        return Failed(reason(given))
    if not isinstance(given, dict):
        refuse(f"goals are {quoted(given)}, expected an object of goals by agent")
    return checked(given, scene, names)


def _json(line: bytes) -> Any:
    try:
        return json.loads(line.decode(), parse_constant=_no_number, object_pairs_hook=_once)
    except RecursionError:
        refuse("invalid JSON: too deeply nested")
    except ValueError as error:  # of JSON, of UTF-8, and of integers with thousands of digits
        refuse(f"invalid JSON: {error}")


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the object with these pairs; duplicate names are an error."""
    made = dict(pairs)
    if len(made) < len(pairs):
        raise ValueError(f"duplicate name in {quoted([name for name, _ in pairs])}")
    return made
