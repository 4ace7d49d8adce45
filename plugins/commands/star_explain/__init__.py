"""Command ``star explain``: prints a mission as a plan, or draws it; checks by a rehearsal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final
from weakref import WeakKeyDictionary

from star_core import Problem, deferred, hookimpl
from star_core.commands import CommandSpec
from star_core.toolkit import actions

if TYPE_CHECKING:
    from star_core import Mission, Registry
    from star_core.toolkit import Rehearsal

MOST_COMPARED = 100  # agents: comparing the pairs of more takes many seconds


@hookimpl
def star_commands() -> Iterator[CommandSpec]:
    yield CommandSpec(
        name="explain",
        summary="Print a mission as a plan with every timeout, or draw it (Mermaid).",
        configure=deferred("star_explain.command:configure"),
        run=deferred("star_explain.command:run"),
        group="Author",
    )


@hookimpl
def star_check(mission: Mission, registry: Registry) -> Iterator[Problem]:
    planner = registry.find("planner", mission.plugins["planner"].use).offer
    blocked = mission.scene.world.obstacles and not planner.avoids_obstacles
    timed = any(
        step.timeout is not None
        and step.until is None
        and registry.find("task", step.verb).offer.exclusive is None
        for step in actions(mission.all_steps)
    )
    yield from exact_positions_only(mission, registry)
    few = len(mission.scene.agents) <= MOST_COMPARED
    margins = drifts(mission, registry) and mission.scene.limits.separation > 0
    if few or blocked or timed or margins or follows_surfaces(mission, registry):
        from star_explain.problems import problems

        yield from problems(mission, registry)


def drifts(mission: Mission, registry: Registry) -> bool:
    """Return whether agents keep margins for the drift of positions that a localizer announces."""
    offer = registry.find("localizer", mission.plugins["localizer"].use).offer
    return offer.drift is not None and mission.scene.limits.uncertainty_margin > 0


def exact_positions_only(mission: Mission, registry: Registry) -> Iterator[Problem]:
    """Warn if an avoider that is made for exact positions has to do with uncertain ones."""
    scene, avoider = mission.scene, mission.plugins["avoider"]
    uncertain = scene.measures_positions or not scene.exact_odometry
    offers = registry.offers()["avoider"]
    if (
        uncertain
        and len(scene.agents) > 1
        and scene.limits.uncertainty_margin > 0
        and not offers[avoider.use].uncertain_positions
    ):
        others = [
            name
            for name, offer in offers.items()
            if offer.uncertain_positions and offer.avoids_obstacles
        ]
        hint = f"use {' or '.join(others)}, or more space" if others else "give them more space"
        yield Problem(
            ("avoider",),
            f"{avoider.use!r} is not made for uncertain positions: in narrow places agents may "
            f"wait for each other forever; {hint}",
            "avoider-needs-exact-positions",
            warning=True,
        )


def follows_surfaces(mission: Mission, registry: Registry) -> bool:
    """Return whether drones measure their heights from obstacles below them."""
    used = mission.plugins["transport"]
    offer = registry.find("transport", used.use).offer
    if not mission.scene.world.obstacles:
        return False
    return offer.heights_above_surface is None or offer.heights_above_surface(**used.options)


_rehearsals: Final = WeakKeyDictionary["Registry", WeakKeyDictionary["Mission", "Rehearsal"]]()


@hookimpl
def star_rehearse(mission: Mission, registry: Registry) -> Rehearsal:
    """Rehearse a mission once while it exists: it is checked, and its duration is shown."""
    rehearsals = _rehearsals.setdefault(registry, WeakKeyDictionary())
    rehearsal = rehearsals.get(mission)
    if rehearsal is None:
        from star_explain.rehearse import rehearse

        rehearsal = rehearsals[mission] = rehearse(mission, registry)
    return rehearsal
