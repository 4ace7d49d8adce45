"""Localizer ``onboard``: the drones' own estimators know the map."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

from star_core import LocalizerSpec, Problem, deferred, hookimpl
from star_core.toolkit import positive, shortlist

if TYPE_CHECKING:
    from star_core import Scene

SYSTEMS: Final = ("lighthouse", "loco", "poses")
BEACONS: Final = {"lighthouse": "base_stations", "loco": "anchors"}

MAX_YAW: Final = math.radians(10.0)  # rad, of a start by Loco: an error for `star preflight`

DEVIATION: Final[dict[str, Any]] = {
    "type": ["number", "null"],
    "exclusiveMinimum": 0,
    "maximum": 10,
    "default": None,
}

OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "system": {
            "enum": list(SYSTEMS),
            "default": "poses",
            "description": "By which the estimators know the map: 'lighthouse' or 'loco', with the "
            "base stations or anchors of the world, or 'poses' that another program sends.",
        },
        "std": {
            **DEVIATION,
            "description": "Standard deviation of the system's errors along x and along y, m, "
            "which the estimators do not know; null is 0.014 for Lighthouse, 0.05 for Loco (0.02 "
            "without a Flow deck) and 0.005 for poses.",
        },
        "height_std": {
            **DEVIATION,
            "description": "Likewise along z, m; null is 0.01 with a Flow deck, and without 0.014 "
            "for Lighthouse, 0.075 for Loco and 0.005 for poses.",
        },
        "max_std": {
            **DEVIATION,
            "description": "Standard deviation along an axis that an estimator may report, m: with "
            "more, an agent is not located. null is 0.1, which a Flow deck alone reaches within "
            "some 5 s, and 0.25 without a Flow deck.",
        },
        "max_report_age": positive("Age up to which an agent's report is valid, s.", default=0.5),
    },
}


def check(scene: Scene, *, system: str, **_options: Any) -> Iterable[Problem]:
    """Require a transport whose drones know the map by this system, its beacons, and headings."""
    simulated = scene.onboard_system
    if simulated is None and not scene.realtime:
        text = (
            "the simulated drones receive no positioning system; write transport: "
            f"{{use: sim, onboard: {{system: {system}}}}}"
        )
        yield Problem((), text, "no-positioning")
    elif simulated not in (None, system):
        text = (
            f"the simulated drones receive {simulated!r}, not {system!r}; write localizer: "
            f"{{use: onboard, system: {simulated}}}"
        )
        yield Problem(("system",), text, "option-conflict")
    if system == "loco":
        agents = scene.agents
        turned = [each.name for each in agents if abs(math.remainder(each.yaw, math.tau)) > MAX_YAW]
        if turned:
            text = (
                "anchors measure no heading, and estimators begin along the x axis; start "
                f"{shortlist(turned)} without yaw_deg"
            )
            yield Problem(("system",), text, "option-conflict", warning=not scene.realtime)
    place = BEACONS.get(system)
    if place is not None and not getattr(scene.world, place):
        text = (
            f"world {scene.world.name!r} has no {place}: where {system!r} is received is not known"
        )
        yield Problem(("system",), text, "no-positioning", warning=bool(scene.realtime))


@hookimpl
def star_localizers() -> Iterable[LocalizerSpec]:
    yield LocalizerSpec(
        name="onboard",
        summary="Take positions of on-board estimators that know the map: Lighthouse, Loco, poses.",
        make=deferred("star_onboard.localizer:Onboard"),
        options=OPTIONS,
        check=check,
        corrects_heights=True,
        edge_clearance=0.5,  # benchmarks/heights.py
        drift=deferred("star_onboard.systems:expected_std"),
        covered=deferred("star_onboard.systems:is_covered"),
        reports_in_map=True,
    )
