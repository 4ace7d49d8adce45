"""What the other process may say, one JSON object a line, and what is wrong with it.

    {"goals": {"cf1": {"position": [x, y, z]}}}    goals; those not named keep theirs
    {"done": true}                                 the step is over, and a success
    {"fail": "why"}                                the step failed

A goal has a ``position``, m in the map, and may have a ``velocity`` (of the goal, m/s), a ``yaw``
(rad) and a ``speed`` (greatest on the way, m/s). Nothing here imports numpy.
"""

from __future__ import annotations

import json
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, Final, NoReturn

from star_external.goals import checked
from star_external.planner import Answer, Done, Failed
from star_external.words import listed, quoted, reason, refuse

if TYPE_CHECKING:
    from star_core import Scene

KEYS: Final = ("goals", "done", "fail")


def read(line: bytes, scene: Scene, names: Collection[str]) -> Answer:
    """Return what a line says: goals by agent, that the step is over, or that it failed.

    Args:
        line: One line.
        scene: Fence, obstacles and limits, within which goals are to be.
        names: Agents that goals may be for.

    Raises:
        InputError: It says nothing that it may, or one of its goals cannot be flown to.

    Example:
        >>> from star_core.testing import scene
        >>> read(b'{"fail": "no way"}', scene(1), ["cf1"])
        Failed(why='no way')
    """
    said = _json(line)
    if not isinstance(said, dict) or len(said) != 1 or next(iter(said)) not in KEYS:
        refuse(f"expected an object with one of {listed(KEYS)}, got {quoted(said)}")
    ((key, given),) = said.items()
    if key == "done":
        if given is not True:
            refuse(f"done is {quoted(given)}, expected true")
        return Done()
    if key == "fail":
        if not isinstance(given, str):
            refuse(f"fail is {quoted(given)}, expected why, in words")
        return Failed(reason(given))
    if not isinstance(given, dict):
        refuse(f"goals are {quoted(given)}, expected an object of goals by agent")
    return checked(given, scene, names)


def _json(line: bytes) -> Any:
    try:
        return json.loads(line.decode(), parse_constant=_no_number, object_pairs_hook=_once)
    except RecursionError:
        refuse("no JSON: too deep")
    except ValueError as error:  # of JSON, of UTF-8, and of integers with thousands of digits
        refuse(f"no JSON: {error}")


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make an object of what is in it, if every name is there once."""
    made = dict(pairs)
    if len(made) < len(pairs):
        raise ValueError(f"a name stands twice in {quoted([name for name, _ in pairs])}")
    return made
