"""Checks of a verb's options that a schema cannot express. Does not import numpy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from star_core import Problem, StepGoal
from star_verbs.places import rooms, slot_faults, too_fast
from star_verbs.slots import slots

if TYPE_CHECKING:
    from star_core import Scene

SPACING = 0.6  # m, the default in the schemas


def takeoff(scene: Scene, _rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    if fault := scene.height_fault(options.get("height", 0.8)):
        yield Problem(("height",) if "height" in options else (), fault)


def leave(scene: Scene, _rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    yield from too_fast(scene, options)


def hold(scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    yield from too_fast(scene, options)
    yield from _spread(scene, len(rows), "at", options)


def goto(scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[Problem]:
    yield from too_fast(scene, options)
    yield from one_of("to", "by", options)
    yield from _spread(scene, len(rows), "to", options)
    if "by" in options:
        yield from _span(scene, options["by"])


def hold_goals(_scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[StepGoal]:
    yield from _slot_goals(len(rows), "at", options)


def goto_goals(_scene: Scene, rows: tuple[int, ...], **options: Any) -> Iterator[StepGoal]:
    yield from _slot_goals(len(rows), "to", options)


def one_of(one: str, other: str, options: dict[str, Any]) -> Iterable[Problem]:
    """Check that exactly one of two options is given."""
    given = (one in options) + (other in options)
    if given == 0:
        yield Problem((), f"expected {one!r} or {other!r}")
    elif given > 1:
        yield Problem((other,), f"{other!r} does not go with {one!r}, expected one of them")


def _spread(scene: Scene, agents: int, key: str, options: dict[str, Any]) -> Iterable[Problem]:
    if key not in options:
        return
    too_near = list(near(scene, agents, options))
    yield from too_near
    if not too_near:
        places = slots(agents, options[key], options.get("spacing", SPACING))
        yield from (Problem((key,), message) for message in slot_faults(scene, places))


def _slot_goals(agents: int, key: str, options: dict[str, Any]) -> Iterator[StepGoal]:
    """The positions of several agents sent around one point."""
    if key in options:
        places = slots(agents, options[key], options.get("spacing", SPACING))
        for number, place in enumerate(places, start=1):
            label = f"place {number} of {agents}" if agents > 1 else ""
            yield StepGoal((key,), place, label)


def near(scene: Scene, agents: int, options: dict[str, Any]) -> Iterable[Problem]:
    """Check that the spacing is not less than the separation that the core enforces."""
    spacing, least = options.get("spacing", SPACING), scene.limits.separation
    if agents > 1 and spacing < least:
        path = ("spacing",) if "spacing" in options else ()
        yield Problem(
            path, f"a spacing of {spacing:g} m is less than limits.separation, {least:g} m"
        )


def _span(scene: Scene, offset: Sequence[float]) -> Iterable[Problem]:
    """Check that an offset is not too long for the room, wherever it begins."""
    for axis, by, room in zip("xyz", offset, rooms(scene), strict=True):
        if abs(by) > room:
            where = "the heights to fly at are" if axis == "z" else "the fence is"
            yield Problem(("by",), f"{abs(by):g} m along {axis}, where {where} only {room:g} m")
