"""Conditions in which drones of a fleet are before a flight: what ``star preflight`` finds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Final, TypeAlias

import numpy as np

from star_core import InputError, Mask, Scene
from star_core.toolkit import SYSTEMS, suggestion
from star_sim.drone import Drones

EMPTY: Final = 0.01  # charge of an empty battery, as a fraction of full: 3.0 V
DISPLACEMENT: Final = 0.5  # m along the map's x axis
GROWTH: Final = 2.5e-3  # m²/s² per second: of a velocity that is not measured, 0.5 m/s² of noise


class Condition(StrEnum):
    """A fault that a drone has before the flight, or a deck that it carries."""

    LIGHTHOUSE = "lighthouse"  # a deck that receives two base stations
    LOCO = "loco"  # a deck that ranges to eight anchors
    POSES = "poses"  # another program sends it its poses
    NO_STATIONS = "no-stations"  # a Lighthouse deck that receives none
    EMPTY_BATTERY = "empty-battery"
    FAILED_SELF_TEST = "failed-self-test"
    NO_FLOW_DECK = "no-flow-deck"
    NO_AI_DECK = "no-ai-deck"
    DECK_FAULT = "deck-fault"
    LOCKED = "locked"
    CRASHED = "crashed"
    TUMBLED = "tumbled"
    UNSETTLED = "unsettled"  # its estimator has no measurements of the velocity
    DISPLACED = "displaced"  # 0.5 m along the map's x axis from its start
    NO_IMAGES = "no-images"
    DARK_IMAGES = "dark-images"


Conditions: TypeAlias = Mapping[int, frozenset[Condition]]
"""Conditions by row."""

NONE: Final[frozenset[Condition]] = frozenset()
SWITCHES: Final[Mapping[Condition, str]] = {
    Condition.LIGHTHOUSE: "lighthouse.enableEst",
    Condition.LOCO: "loco.enableEst",
    Condition.POSES: "",
}
"""Conditions in which an estimator knows the map, and the parameters that enable it, if any."""


def read_conditions(texts: Iterable[str], scene: Scene) -> Conditions:
    """Return the conditions of ``AGENT=CONDITION`` each.

    Raises:
        InputError: There is no such agent or condition, or what a deck receives is not simulated.
    """
    rows: dict[int, frozenset[Condition]] = {}
    for text in texts:
        name, _, condition = text.partition("=")
        if name not in scene.names:
            hint = suggestion(name, scene.names, "there are")
            raise InputError(f"--condition {text}: no agent named {name!r}{hint}", "unknown-agent")
        names = [each.value for each in Condition]
        if condition not in names:
            hint = suggestion(condition, names, "there are")
            wrong = f"--condition {text}: no condition {condition!r}{hint}"
            raise InputError(wrong, "invalid-option")
        if condition in SYSTEMS and condition != scene.onboard_system:
            raise InputError(
                f"--condition {text}: the simulated drones do not receive {condition!r}; fly a "
                f"mission with transport: {{use: sim, onboard: {{system: {condition}}}}}",
                "no-positioning",
            )
        row = scene.names.index(name)
        rows[row] = rows.get(row, NONE) | {Condition(condition)}
    return rows


def with_receivers(conditions: Conditions, scene: Scene) -> Conditions:
    """Return conditions in which drones know the map by the mission's positioning system.

    A drone with a deck that receives nothing does not. Without Flow decks, none has one.
    """
    if scene.onboard_system is None:
        return conditions
    receives = frozenset({Condition(scene.onboard_system)})
    lacks = NONE if scene.flow_deck else frozenset({Condition.NO_FLOW_DECK})
    rows = {row: lacks | conditions.get(row, NONE) for row in range(len(scene.agents))}
    return {
        row: some if Condition.NO_STATIONS in some else some | receives
        for row, some in rows.items()
    }


def prepare(drones: Drones, conditions: Conditions) -> None:
    """Empty batteries, and move drones, as their conditions are."""
    for row, some in conditions.items():
        if Condition.EMPTY_BATTERY in some:
            drones["charge"][row] = EMPTY
        if Condition.DISPLACED in some:
            drones["position"][row, 0] += DISPLACEMENT
            drones["origin"][row, 0] += DISPLACEMENT


def drones_in(conditions: Conditions, n: int, *which: Condition) -> Mask:
    """Return which of `n` drones are in one of some conditions: (N,)."""
    return np.array([bool({*which} & conditions.get(row, NONE)) for row in range(n)])
