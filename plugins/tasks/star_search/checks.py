"""What is wrong with the options of a search that a schema cannot see. Nothing imports numpy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Final

from star_core import Problem
from star_search import area as areas
from star_search.view import swaths

if TYPE_CHECKING:
    from star_core import Scene

DEFAULT_SPEED: Final = 0.3  # m/s
STAYS: Final = ("land", "hover")
"""What `then` may say with which a finder searches no more."""


def check(  # noqa: PLR0913 -- a mission's own options
    scene: Scene,
    rows: tuple[int, ...],
    *,
    area: areas.Area | None = None,
    height: float,
    speed: float,
    swath: float | None = None,
    clearance: float,
    targets: int | Sequence[str] | None = None,
    then: str,
    **_others: Any,
) -> Iterator[Problem]:
    """Yield every reason why a search cannot be flown."""
    yield from (Problem(("area", *path), message) for path, message in areas.faults(scene, area))
    if fault := scene.height_fault(height):
        yield Problem(("height",), fault)
    pace = min(speed, scene.limits.speed)
    if speed != DEFAULT_SPEED and speed > pace:
        yield Problem(
            ("speed",), f"{speed:g} m/s is above limits.speed, {scene.limits.speed:g} m/s"
        )
    blind = [row for row in rows if scene.agents[row].camera is None]
    if blind:
        has = "has" if len(blind) == 1 else "have"
        yield Problem(
            (),
            f"{scene.named(blind)} {has} no camera to search with; "
            "give agents `camera: aideck`, or name those that have one",
        )
    else:
        yield from _swath(scene, rows, height, pace, swath)
    fence = scene.world.fence
    narrow = min(fence.high[0] - fence.low[0], fence.high[1] - fence.low[1])
    if 2 * clearance >= narrow:
        yield Problem(
            ("clearance",),
            f"{clearance:g} m on both sides leave nothing of the fence's {narrow:g} m",
        )
    wrong = [*areas.faults(scene, area), *blind, *(unknown := [*_targets(scene, targets)])]
    yield from unknown
    if then in STAYS and not wrong:
        wide = max(widest for _, widest in swaths(scene, rows, height, pace))
        if (there := _far_apart(scene, area, targets, wide)) > len(rows):
            yield Problem(
                ("then",),
                f"each finder stays at its target, so {scene.named(rows)} cannot find the {there} "
                "that are in the area; send more scouts, let them 'mark' or 'continue', or ask "
                "for fewer 'targets'",
            )


def _swath(
    scene: Scene, rows: tuple[int, ...], height: float, speed: float, swath: float | None
) -> Iterator[Problem]:
    for row, widest in swaths(scene, rows, height, speed):
        name = scene.agents[row].name
        if widest <= 0:
            yield Problem(
                ("height",),
                f"from {height:g} m at {speed:g} m/s, {name!r} makes out no tag on the floor "
                "for long enough; search lower or slower, or turn its camera down",
            )
        elif swath is not None and swath > widest:
            yield Problem(
                ("swath",),
                f"{swath:g} m is more than the {widest:.2f} m in which {name!r} makes out tags "
                f"on the floor from {height:g} m",
            )
        else:
            continue
        return


def _far_apart(
    scene: Scene, area: areas.Area | None, targets: int | Sequence[str] | None, wide: float
) -> int:
    """How many of the wanted targets are in the area, none in view on the way to another.

    Args:
        scene: The mission's scene.
        area: As the mission gives it.
        targets: How many, or which; None for all.
        wide: What a camera sees of the floor, m.
    """
    ring = areas.corners(scene, area)
    found: dict[str, tuple[float, float]] = {}
    for tag in scene.world.targets:
        x, y, _ = tag.position
        new = tag.of not in found and all(math.dist(one, (x, y)) > wide for one in found.values())
        if (
            new
            and areas.inside(ring, x, y)
            and (targets is None or isinstance(targets, int) or tag.of in targets)
        ):
            found[tag.of] = (x, y)
    return min(len(found), targets) if isinstance(targets, int) else len(found)


def _targets(scene: Scene, targets: int | Sequence[str] | None) -> Iterator[Problem]:
    known = list(dict.fromkeys(tag.of for tag in scene.world.targets))
    if isinstance(targets, int):
        if targets > len(known):
            yield Problem(
                ("targets",), f"{targets!r} is more than the {len(known)} targets of the world"
            )
        return
    for i, name in enumerate(targets or ()):
        if name not in known:
            near = get_close_matches(name, known, 1)
            meant = f"; did you mean {near[0]!r}?" if near else f"; there are: {', '.join(known)}"
            yield Problem(("targets", i), f"no target named {name!r}{meant}")
