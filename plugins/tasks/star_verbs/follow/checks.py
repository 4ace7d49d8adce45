"""Checks of the options of ``follow`` that a schema cannot express. Does not import numpy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from star_core import InputError, Problem, StepGoal
from star_verbs.checks import SPACING, near, one_of
from star_verbs.follow.envelope import (
    limit_faults,
    place_faults,
    room_faults,
    samples,
    thinned,
    trajectory_positions,
)
from star_verbs.follow.routes import least_distance, positions, route, way_faults
from star_verbs.follow.trajectory import read
from star_verbs.places import too_fast
from star_verbs.slots import slots

if TYPE_CHECKING:
    from star_core import Scene

POLY7 = ("format", "timescale", "relative", "on_board")  # options of `follow` for trajectories
MEMORY = 4096  # bytes of a Crazyflie's trajectory memory
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
    options = _without_poly7(options)
    yield from too_fast(scene, options)
    before = list(one_of("file", "path", options)) or list(_company(options))
    if before:
        yield from before
        return
    if too_near := list(near(scene, len(rows), options)):
        yield from too_near
        return
    try:
        way = route(scene, len(rows), **_source(options))
    except InputError as error:
        yield from (Problem(("file",), message) for message in error.problems)
        return
    yield from _room(options, len(rows))
    key = "file" if "file" in options else "path"
    yield from (
        Problem((key,), message) for message in way_faults(scene, way, options.get(key, ""))
    )


def goals(scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[StepGoal]:
    """Yield the positions along each agent's line; a relative trajectory's are not known."""
    key = "file" if "file" in options else "path"
    if options.get("format") != "poly7":
        way = route(scene, len(rows), **_source(_without_poly7(options)))
        found = positions(way, options[key])
    elif options.get("relative", True):
        return
    else:
        shifts = slots(len(rows), (0.0, 0.0, 0.0), options.get("spacing", SPACING))
        line = samples(read(scene.file(options[key]), options[key]))
        flown = line[:1] if options.get("on_board") else line  # planned to its start only
        found = trajectory_positions(flown, shifts, options[key])
    yield from (StepGoal((key,), point, label) for label, point in found)


def _without_poly7(options: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in options.items() if key not in POLY7}


def _source(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that define the line to fly."""
    return {key: value for key, value in options.items() if key not in {"heading", "speed"}}


def _poly7(scene: Scene, agents: int, options: dict[str, Any]) -> Iterable[Problem]:
    """Check a trajectory; where a relative one leads is checked when it begins."""
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
    """Check that a trajectory fits into an agent's memory."""
    if pieces * PIECE > MEMORY:
        yield Problem(
            ("on_board",),
            f"{name} has {pieces} pieces of {PIECE} bytes, {pieces * PIECE} bytes in all; a "
            f"Crazyflie has {MEMORY} bytes for trajectories: {MEMORY // PIECE} pieces at most",
        )


def _company(options: dict[str, Any]) -> Iterable[Problem]:
    """Check that options of a named path are not combined with a file."""
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
