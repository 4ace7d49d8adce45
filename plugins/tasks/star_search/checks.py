"""What is wrong with the options of a search that a schema cannot see. Nothing imports numpy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from star_core import Problem
from star_search import area as areas
from star_search.view import swaths

if TYPE_CHECKING:
    from star_core import Scene


def check(
    scene: Scene,
    rows: tuple[int, ...],
    *,
    area: areas.Area | None = None,
    height: float = 0.8,
    speed: float = 0.3,
    swath: float | None = None,
    clearance: float = 0.3,
    targets: int | Sequence[str] | None = None,
    **_others: Any,
) -> Iterator[Problem]:
    """Yield every reason why a search cannot be flown."""
    yield from (Problem(("area", *path), message) for path, message in areas.faults(scene, area))
    if fault := scene.height_fault(height):
        yield Problem(("height",), fault)
    blind = [row for row in rows if scene.agents[row].camera is None]
    if blind:
        has = "has" if len(blind) == 1 else "have"
        yield Problem(
            (),
            f"{scene.named(blind)} {has} no camera to search with; "
            "give agents `camera: aideck`, or name those that have one",
        )
    else:
        yield from _swath(scene, rows, height, min(speed, scene.limits.speed), swath)
    fence = scene.world.fence
    narrow = min(fence.high[0] - fence.low[0], fence.high[1] - fence.low[1])
    if 2 * clearance >= narrow:
        yield Problem(
            ("clearance",),
            f"{clearance:g} m on both sides leave nothing of the fence's {narrow:g} m",
        )
    yield from _targets(scene, targets)


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
