"""Brakes agents whose tilt or drag contradicts the velocities that they report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from star_core import Scene
from star_core.toolkit import Misreport, Report, Stage, TickState, Use, some
from star_monitors.drag_check import DragCheck
from star_monitors.motion_check import MotionCheck


class FlowMonitor:
    """Brakes agents whose flow sensors are stuck, or measure less motion than there is.

    Agents without Flow decks are not judged.
    """

    after = Stage.LOCATED

    def __init__(self, scene: Scene) -> None:
        n = len(scene.agents)
        self._names = scene.names
        self._flow_deck = scene.flow_deck
        self._motion = MotionCheck(n)
        self._drag = DragCheck(n)
        self._contradicted = np.zeros(n, np.bool_)

    def check(self, state: TickState) -> Iterator[Report | Use | Misreport]:
        """Yield reports of such agents, their estimates as not valid, and what they misreport."""
        if not self._flow_deck:
            return
        estimate, telemetry, airborne = state.estimate, state.telemetry, state.airborne
        tilts = self._motion.check(telemetry, airborne)
        dragged = self._drag.check(telemetry, airborne, tilts)
        self._motion.correct(self._drag.missing)
        contradicted, before = tilts | dragged, self._contradicted
        self._contradicted = contradicted
        if not some(contradicted):
            return
        for row in (contradicted & ~before).nonzero()[0].tolist():
            by = "tilt" if tilts[row] else "drag"
            text = f"{self._names[row]} brakes: it flies faster than it reports, by its {by}"
            text += "; does its flow sensor see the floor?"
            yield Report("estimate", text, self._names[row])
        by_tilt, by_drag = self._motion.errors(), self._drag.errors()
        away, faster = (
            estimate.map_from_odom.turn(tilt + drag)
            for tilt, drag in zip(by_tilt, by_drag, strict=True)
        )
        yield Use(
            "estimate",
            replace(
                estimate,
                position=estimate.position + away,
                velocity=estimate.velocity + faster,
                valid=estimate.valid & ~contradicted,
            ),
        )
        yield Misreport(by_tilt[1], tilts)
