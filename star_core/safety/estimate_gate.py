"""Rejects estimated positions to which agents cannot have flown, and implausible reports."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from star_core.messages.arrays import Array, Mask, every, frozen
from star_core.messages.rotations import Transform
from star_core.messages.state import Estimate
from star_core.safety.agents_in_the_way import MAX_REPORT_AGE
from star_core.safety.monitors import Report, Stage, TickState, Use
from star_core.toolkit.jit import compiled
from star_core.world.scene import Scene

SPOILED_TIME: Final = 1.0  # s without an implausible report, after which reports are used again

JUMP_MARGIN: Final = 1.5
"""How far positions may move beyond what is explained, m: localizers are sometimes overconfident.
In 30 flights with `method: batch`, the worst localizer here, it was 1.0 m at most."""

UNCORRECTED_MARGIN: Final = 0.5
"""Likewise for an agent whose position has not been corrected in this flight, m: estimates by dead
reckoning do not jump."""

MAX_HEIGHT_JUMP: Final = 0.3
"""Greatest difference in height from the motion that an agent reports, and from the height that it
reports too, m: rangers do not drift, and localizers do not correct heights by that much."""

CORRECTED_SHARE: Final = 0.95
"""Ratio of the variances after and before a tick below which the position was corrected. While an
agent flies back to its start, that of dead reckoning shrinks by some per mille."""

MAX_STILL_PATH: Final = 0.3
"""Greatest path that an agent may report while its estimated position does not change at all, m."""

FORGETTING_TIME: Final = 5.0  # s, time constant with which unexplained movement is forgotten
CORRECTION_SIGMAS: Final = 4.0  # standard deviations by which a position may be corrected
SPEED_RATIO: Final = 2.0  # greatest plausible speed over the limit: overshoot, gusts, descents
REPORT_ERROR: Final = 0.3  # greatest error of a reported velocity, relative to it
MIN_PLAUSIBLE_SPEED: Final = 3.0  # m/s, whatever the limit: on-board trajectories, falls


class EstimateMonitor:
    """Rejects estimates that contradict what agents report, so that these agents brake."""

    after = Stage.LOCATED

    def __init__(self, scene: Scene, localizer: str) -> None:
        self._names = scene.names
        self._localizer = localizer
        self._gate = EstimateGate(len(scene.agents), scene.limits.speed)
        self._frames = Transform(  # last known
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )

    def check(self, state: TickState) -> Iterator[Report | Use]:
        """Yield the estimate without implausible positions, and reports of new ones.

        Agents whose frames are not finite have the last known ones.
        """
        estimate, telemetry = state.estimate, state.telemetry
        if estimate.map_from_odom is not self._frames:
            if not estimate.map_from_odom.all_known:
                frames = estimate.map_from_odom.where(estimate.map_from_odom.known, self._frames)
                estimate = replace(estimate, map_from_odom=frames)
            self._frames = estimate.map_from_odom
        heard = telemetry.age <= MAX_REPORT_AGE
        velocity, position = telemetry.velocity, telemetry.position
        if estimate.heights is not None:  # over another surface than at the start
            position, velocity = (
                np.column_stack([reported[:, :2], over_start])
                for reported, over_start in zip(
                    (position, velocity), estimate.heights.T, strict=True
                )
            )
            position, velocity = frozen(position), frozen(velocity)
        accepted, jumps = self._gate.check(estimate, state.airborne, heard, velocity, position)
        for jump in jumps:
            yield Report("estimate", self._of_jump(jump), self._names[jump.row])
        if accepted is not state.estimate:
            yield Use("estimate", accepted)

    def _of_jump(self, jump: Jump) -> str:
        moved = (
            f"moved {jump.distance:.2f} m in {jump.seconds:.2f} s, expected at most "
            f"{jump.plausible:.2f} m"
        )
        if np.isnan(jump.plausible):
            moved = f"did not change while it reported {jump.distance:.2f} m of flight,"
        name = self._names[jump.row]
        return f"{name} brakes: its estimated position {moved} from {self._localizer}"


@dataclass(frozen=True, slots=True)
class Jump:
    """A position that was rejected after one that was accepted.

    Attributes:
        row: Of the agent.
        distance: From the last position that was accepted, m.
        seconds: Time since then, s.
        plausible: Greatest distance that would have been accepted, m; NaN if the estimate has not
            moved at all while the agent reported that it flew `distance`.
    """

    row: int
    distance: float
    seconds: float
    plausible: float


class EstimateGate:
    """Compares each estimated position with the last one that was accepted.

    In the time between the two an agent can have flown some distance, and a localizer can have
    corrected it by as much as the covariance shrank: the covariance of a correction is that of the
    estimate before less that of the estimate after it (Kalman). Movement beyond that adds up over
    ticks, and is forgotten in `FORGETTING_TIME`; many small jumps are a large one. A position with
    which it exceeds `JUMP_MARGIN`, or `UNCORRECTED_MARGIN` for an agent whose covariance no
    correction has shrunk so far, is rejected: the row keeps its last position, at rest and not
    valid, so that the agent brakes. It is compared again in the next tick, with the last position
    that was accepted moved on by the velocities that the agent has reported since then: a jump that
    lasts does not become plausible with time. A position that is the same, to the last bit, while
    the agent reports that it flies `MAX_STILL_PATH` is rejected too: its localizer is stuck. On the
    ground every position is accepted, except that of an agent that was rejected in flight: it came
    down near its last position, not at the wrong one.

    An agent that reports a velocity that is not finite, or that it cannot fly, is not located, on
    the ground either, until its reports have been plausible for `SPOILED_TIME`: random ones are
    plausible once in a while.

    Args:
        n: Number of agents.
        speed: The mission's speed limit, m/s.
    """

    def __init__(self, n: int, speed: float) -> None:
        self._speed = max(SPEED_RATIO * speed, MIN_PLAUSIBLE_SPEED)
        self._time = np.zeros(n)  # s, of the last position that was accepted
        self._position = np.full((n, 3), np.nan)
        self._covariance = np.zeros((n, 3, 3))
        self._frames = Transform(np.zeros(n), np.zeros((n, 3)))
        self._unexplained = np.zeros(n)  # m, recently
        self._rejected = np.zeros(n, np.bool_)
        self._corrected = np.zeros(n, np.bool_)  # agents whose positions have been corrected
        self._flown = np.zeros((n, 3))  # m, since then, by the reported velocities
        self._range = np.zeros(n)  # m, that the agents can have flown since then besides
        self._still_path = np.zeros(n)  # m, that agents report since their estimates last moved
        self._reports = np.zeros(n, np.bool_)  # agents that have reported velocities
        self._spoiled_until = np.full(n, -np.inf)  # s
        self._above = np.full(n, np.nan)  # m, height in the map less the reported one
        self._last_time = 0.0  # s, of the last tick, like the next two
        self._last_position = np.full((n, 3), np.nan)
        self._last_velocity = np.full((n, 3), np.nan)  # m/s, reported
        self._accepted, self._stands = np.zeros((2, n), np.bool_)  # in this tick, or stays
        self._jumps = np.empty((n, 3))  # m, s, m: the fields of `Jump` in this tick
        self._judge(0.0, *_nothing(), self._frames.yaw)  # compiled before the flight

    def check(
        self, estimate: Estimate, airborne: Mask, heard: Mask, velocity: Array, position: Array
    ) -> tuple[Estimate, Sequence[Jump]]:
        """Return the estimate without the positions that are rejected, and the new jumps.

        Args:
            estimate: A localizer's, with map_from_odom finite everywhere.
            airborne: (N,) which agents are in the air.
            heard: (N,) agents that are heard: what they report is used.
            velocity: (N, 3) that the agents report, m/s; NaN if unknown.
            position: (N, 3) that they report, m, for its height; NaN if unknown.
        """
        stands = self._judge(
            float(estimate.time),
            estimate.position,
            estimate.covariance,
            estimate.valid,
            airborne,
            heard,
            velocity,
            position,
            self._frames.yaw,
        )
        self._last_time = estimate.time
        frames = estimate.map_from_odom
        if not every(self._accepted):
            frames = frames.where(self._accepted, self._frames)
        self._frames = frames
        if not stands:
            return estimate, ()
        jumps = [
            Jump(row, *self._jumps[row].tolist())
            for row in np.flatnonzero(~np.isnan(self._jumps[:, 0])).tolist()
        ]
        column = self._stands[:, None]
        return replace(
            estimate,
            position=np.where(column, self._position, estimate.position),
            velocity=np.where(column, 0.0, estimate.velocity),
            covariance=np.where(column[..., None], self._covariance, estimate.covariance),
            valid=self._accepted.copy(),
            map_from_odom=self._frames.where(self._stands, estimate.map_from_odom),
        ), jumps

    def _judge(self, *tick: Any) -> bool:
        return judge(  # type: ignore[call-arg]  # those that it has
            *tick,
            self._speed,
            float(self._last_time),
            self._last_position,
            self._last_velocity,
            self._time,
            self._position,
            self._covariance,
            self._unexplained,
            self._rejected,
            self._corrected,
            self._flown,
            self._range,
            self._still_path,
            self._reports,
            self._spoiled_until,
            self._above,
            self._accepted,
            self._stands,
            self._jumps,
        )


def _nothing() -> tuple[Any, ...]:
    """Return an estimate of no agent, of the types that it has in flight."""
    columns = ((3,), np.float64), ((3, 3), np.float64), ((), np.bool_)
    position, covariance, valid = (frozen(np.zeros((0, *row), kind)) for row, kind in columns)
    unheard = np.zeros(0, np.bool_)
    return position, covariance, valid, unheard, unheard, position, position


@compiled
def judge(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917 -- the gate, in one pass
    time: float,
    position: Array,
    covariance: Array,
    valid: Mask,
    airborne: Mask,
    heard: Mask,
    velocity: Array,
    height: Array,
    yaw: Array,
    top_speed: float,
    last_time: float,
    last_position: Array,
    last_velocity: Array,
    accepted_at: Array,
    accepted_position: Array,
    accepted_covariance: Array,
    unexplained: Array,
    rejected: Mask,
    corrected: Mask,
    flown: Array,
    reach: Array,
    still_path: Array,
    reports: Mask,
    spoiled_until: Array,
    above: Array,
    accepted: Mask,
    stands: Mask,
    jumps: Array,
) -> bool:
    """Accept or reject the estimate of each agent, as `EstimateGate` describes.

    Args:
        time: Of the estimate, s.
        position: (N, 3) m.
        covariance: (N, 3, 3) m².
        valid: (N,) agents that are located.
        airborne: (N,) agents in the air.
        heard: (N,) agents that are heard.
        velocity: (N, 3) that the agents report, m/s.
        height: (N, 3) positions that they report, m.
        yaw: (N,) of the odometry frames that were accepted last, rad.
        top_speed: Greatest plausible speed, m/s.
        last_time: State of the gate, as the next ones, which are updated, s.
        last_position: (N, 3) m.
        last_velocity: (N, 3) m/s.
        accepted_at: (N,) s.
        accepted_position: (N, 3) m.
        accepted_covariance: (N, 3, 3) m².
        unexplained: (N,) m.
        rejected: (N,).
        corrected: (N,).
        flown: (N, 3) m.
        reach: (N,) m.
        still_path: (N,) m.
        reports: (N,).
        spoiled_until: (N,) s.
        above: (N,) m.
        accepted: Set to whether each agent's estimate is accepted.
        stands: Set to whether it keeps its last position instead.
        jumps: Set to the distance, time and plausible distance of new jumps; NaN for others.

    Returns:
        Whether any agent keeps its last position.
    """
    seconds = time - last_time
    any_stands = False
    for row in range(len(valid)):
        vx, vy, vz = velocity[row, 0], velocity[row, 1], velocity[row, 2]
        if not heard[row]:
            vx = vy = vz = math.nan
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        reports[row] = reports[row] or math.isfinite(speed)
        if heard[row] and reports[row] and not speed <= top_speed:
            spoiled_until[row] = time + SPOILED_TIME
        spoiled = time < spoiled_until[row]
        if spoiled:
            vx = vy = vz = speed = math.nan
        if math.isfinite(speed):
            cos, sin = math.cos(yaw[row]), math.sin(yaw[row])
            flown[row, 0] += seconds * (cos * vx - sin * vy)
            flown[row, 1] += seconds * (sin * vx + cos * vy)
            flown[row, 2] += seconds * vz
        # one that is rejected can be elsewhere only by the error of its reports
        is_known = rejected[row] and math.isfinite(speed)
        reach[row] += seconds * (REPORT_ERROR * speed if is_known else top_speed)
        same = airborne[row] and math.isfinite(seconds * speed)
        for axis in range(3):
            same = same and position[row, axis] == last_position[row, axis]
            last_position[row, axis] = position[row, axis]
        new = (  # a report that repeats is an old one
            vx != last_velocity[row, 0]
            or vy != last_velocity[row, 1]
            or vz != last_velocity[row, 2]
        )
        last_velocity[row, 0], last_velocity[row, 1], last_velocity[row, 2] = vx, vy, vz
        path = seconds * speed if new else 0.0
        still_path[row] = still_path[row] + path if same else 0.0
        stuck = still_path[row] > MAX_STILL_PATH
        dx = position[row, 0] - accepted_position[row, 0] - flown[row, 0]
        dy = position[row, 1] - accepted_position[row, 1] - flown[row, 1]
        dz = position[row, 2] - accepted_position[row, 2] - flown[row, 2]
        moved = math.sqrt(dx * dx + dy * dy + dz * dz)
        before, now = 0.0, 0.0
        for axis in range(3):
            before += accepted_covariance[row, axis, axis]
            now += covariance[row, axis, axis]
        shrunk = before - now if before > now else 0.0
        explained = reach[row] + CORRECTION_SIGMAS * math.sqrt(shrunk)
        carried = unexplained[row] * math.exp((accepted_at[row] - time) / FORGETTING_TIME)
        excess = carried + max(moved - explained, 0.0)
        correction = corrected[row] or now < CORRECTED_SHARE * before
        margin = JUMP_MARGIN if correction else UNCORRECTED_MARGIN
        over = position[row, 2] - height[row, 2] if heard[row] else math.nan
        jumped = abs(dz) > MAX_HEIGHT_JUMP and abs(over - above[row]) > MAX_HEIGHT_JUMP
        judged = (airborne[row] or rejected[row]) and valid[row]
        rejects = judged and (excess > margin or jumped or stuck)
        jumps[row, 0] = math.nan
        if rejects and not rejected[row]:
            plausible = explained + margin - carried
            if jumped and plausible > MAX_HEIGHT_JUMP:
                plausible = MAX_HEIGHT_JUMP
            jumps[row, 0] = still_path[row] if stuck else moved
            jumps[row, 1] = time - accepted_at[row]
            jumps[row, 2] = math.nan if stuck else plausible
        accepted[row] = valid[row] and not rejects and not spoiled
        if accepted[row]:
            corrected[row], rejected[row], above[row] = correction, False, over
            accepted_at[row], reach[row] = time, 0.0
            unexplained[row] = excess if judged and math.isfinite(excess) else 0.0
            for axis in range(3):
                flown[row, axis] = 0.0
                accepted_position[row, axis] = position[row, axis]
                for other in range(3):
                    accepted_covariance[row, axis, other] = covariance[row, axis, other]
        else:
            rejected[row] = rejects or rejected[row]
        located = math.isfinite(accepted_position[row, 0] + accepted_position[row, 1])
        located = located and math.isfinite(accepted_position[row, 2])
        stands[row] = rejects or (spoiled and located)
        any_stands = any_stands or stands[row]
    return any_stands
