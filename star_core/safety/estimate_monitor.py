"""Rejects estimates that contradict the velocities and the tilt that agents report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from star_core.messages.arrays import Array, some
from star_core.messages.rotations import Transform
from star_core.safety.agents_in_the_way import MAX_REPORT_AGE
from star_core.safety.drag_check import DragCheck
from star_core.safety.estimate_gate import EstimateGate, Jump
from star_core.safety.monitors import Report, Stage, TickState, Use
from star_core.safety.motion_check import MotionCheck
from star_core.world.scene import Scene


class EstimateMonitor:
    """Rejects estimates that contradict what agents report, so that these agents brake.

    Args:
        scene: Agents and limits.
        localizer: Names the localizer in reports.

    Attributes:
        sees_no_motion: (N,) agents whose tilt contradicts their velocity: their flow sensors are
            stuck.
    """

    after = Stage.LOCATED

    def __init__(self, scene: Scene, localizer: str) -> None:
        n = len(scene.agents)
        self.sees_no_motion = np.zeros(n, np.bool_)
        self._names = scene.names
        self._localizer = localizer
        self._gate = EstimateGate(n, scene.limits.speed)
        self._motion = MotionCheck(n)
        self._drag = DragCheck(n)
        self._contradicted = np.zeros(n, np.bool_)
        self._frames = Transform(  # last known
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )

    def check(self, state: TickState) -> Iterator[Report | Use]:
        """Yield the estimate without implausible positions and motions, and reports of new ones.

        Agents whose frames are not finite have the last known ones.
        """
        estimate, telemetry, airborne = state.estimate, state.telemetry, state.airborne
        if estimate.map_from_odom is not self._frames:
            if not estimate.map_from_odom.all_known:
                frames = estimate.map_from_odom.where(estimate.map_from_odom.known, self._frames)
                estimate = replace(estimate, map_from_odom=frames)
            self._frames = estimate.map_from_odom
        heard = telemetry.age <= MAX_REPORT_AGE
        accepted, jumps = self._gate.check(
            estimate, airborne, heard, telemetry.velocity, telemetry.position
        )
        for jump in jumps:
            yield Report("estimate", self._of_jump(jump), self._names[jump.row])
        tilts = self._motion.check(telemetry, airborne)
        dragged = self._drag.check(telemetry, airborne, tilts)
        self._motion.correct(self._drag.missing)
        self.sees_no_motion = tilts
        contradicted, before = tilts | dragged, self._contradicted
        self._contradicted = contradicted
        if some(contradicted):
            for row in (contradicted & ~before).nonzero()[0].tolist():
                by = "tilt" if tilts[row] else "drag"
                text = f"{self._names[row]} brakes: it flies faster than it reports, by its {by}"
                text += "; does its flow sensor see the floor?"
                yield Report("estimate", text, self._names[row])
            away, faster = map(accepted.map_from_odom.turn, self._errors())
            accepted = replace(
                accepted,
                position=accepted.position + away,
                velocity=accepted.velocity + faster,
                valid=accepted.valid & ~contradicted,
            )
        if accepted is not state.estimate:
            yield Use("estimate", accepted)

    def rest_velocity(self, map_from_odom: Transform) -> Array:
        """Return the velocities, (N, 3) m/s in the map, at which agents are at rest.

        They are zero but for agents whose reports deny a part of their motion.
        """
        _, faster = self._motion.errors()
        return 0.0 - map_from_odom.turn(faster)

    def _errors(self) -> tuple[Array, Array]:
        """Return the differences of (N, 3) positions, m, and velocities, m/s, from the reports."""
        by_tilt, by_drag = self._motion.errors(), self._drag.errors()
        return by_tilt[0] + by_drag[0], by_tilt[1] + by_drag[1]

    def _of_jump(self, jump: Jump) -> str:
        moved = (
            f"moved {jump.distance:.2f} m in {jump.seconds:.2f} s, expected at most "
            f"{jump.plausible:.2f} m"
        )
        if np.isnan(jump.plausible):
            moved = f"did not change while it reported {jump.distance:.2f} m of flight,"
        name = self._names[jump.row]
        return f"{name} brakes: its estimated position {moved} from {self._localizer}"
