"""What is wrong with the options of ``follow`` that a schema cannot see. No numpy here."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from star_core import InputError, Problem
from star_verbs.checks import SPACING, near, one_of
from star_verbs.follow.envelope import (
    limit_faults,
    place_faults,
    room_faults,
    samples,
    thinned,
)
from star_verbs.follow.routes import least_distance, route, way_faults
from star_verbs.follow.trajectory import read
from star_verbs.places import too_fast
from star_verbs.slots import slots

if TYPE_CHECKING:
    from star_core import Scene

POLY7 = ("format", "timescale", "relative", "on_board")  # options of `follow` for trajectories
MEMORY = 4096  # bytes that a Crazyflie has for trajectories
PIECE = 132  # bytes of a piece: 33 numbers


def check(scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    if options.get("format") == "poly7":
        yield from _poly7(scene, len(rows), options)
        return
    yield from (
        Problem((key,), f"{key!r} goes with 'format: poly7' only")
        for key in POLY7[1:]
        if key in options
    )
    options = {key: value for key, value in options.items() if key not in POLY7}
    yield from too_fast(scene, options)
    before = list(one_of("file", "path", options)) or list(_company(options))
    if before:
        yield from before
        return
    if too_near := list(near(scene, len(rows), options)):
        yield from too_near
        return
    source = {key: value for key, value in options.items() if key not in {"heading", "speed"}}
    try:
        way = route(scene, len(rows), **source)
    except InputError as error:
        yield from (Problem(("file",), message) for message in error.problems)
        return
    yield from _room(options, len(rows))
    key = "file" if "file" in options else "path"
    yield from (
        Problem((key,), message) for message in way_faults(scene, way, options.get(key, ""))
    )


def _poly7(scene: Scene, agents: int, options: dict[str, Any]) -> Iterable[Problem]:
    """What is wrong with a trajectory; where one that is relative leads is seen at its begin."""
    allowed = {*POLY7, "file", "spacing"}
    wrong = [
        Problem((key,), f"{key!r} does not go with 'format: poly7'")
        for key in options
        if key not in allowed
    ]
    if "file" not in options:
        wrong.append(Problem((), "'format: poly7' needs 'file'"))
    if wrong:
        return wrong
    if not options.get("relative", True) and (too_near := list(near(scene, agents, options))):
        return too_near
    name = options["file"]
    try:
        trajectory = read(scene.file(name), name)
    except InputError as error:
        return [Problem(("file",), message) for message in error.problems]
    found = samples(trajectory)
    faults = [*limit_faults(scene, found, options.get("timescale", 1.0), name)]
    if options.get("relative", True):
        faults += room_faults(scene, found, name)
    else:
        shifts = slots(agents, (0.0, 0.0, 0.0), options.get("spacing", SPACING))
        faults += place_faults(scene, thinned(found), shifts, name)
    too_long = _memory(len(trajectory.pieces), name) if options.get("on_board") else ()
    return [*too_long, *(Problem(("file",), message) for message in faults)]


def _memory(pieces: int, name: str) -> Iterable[Problem]:
    """A trajectory that does not fit into an agent's memory."""
    if pieces * PIECE > MEMORY:
        yield Problem(
            ("on_board",),
            f"{name} has {pieces} pieces of {PIECE} bytes, {pieces * PIECE} bytes in all; a "
            f"Crazyflie has {MEMORY} bytes for trajectories: {MEMORY // PIECE} pieces at most",
        )


def _company(options: dict[str, Any]) -> Iterable[Problem]:
    """What goes with a named path goes with no file."""
    for key in ("size", "centre"):
        if "path" in options and key not in options:
            yield Problem((), f"path {options['path']!r} needs {key!r}")
    for key in ("size", "width", "centre", "laps"):
        if "file" in options and key in options:
            yield Problem((key,), f"{key!r} goes with 'path' only, not with 'file'")


def _room(options: dict[str, Any], agents: int) -> Iterable[Problem]:
    if "path" not in options or agents == 1:
        return
    spacing = options.get("spacing", SPACING)
    nearest = least_distance(options["path"], options["size"], agents, options.get("width"))
    if nearest < spacing:
        yield Problem(
            ("size",),
            f"{agents} agents on this {options['path']} come within {nearest:.2f} m of each other, "
            f"nearer than the spacing of {spacing:g} m",
        )
