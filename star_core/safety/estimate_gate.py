"""Rejects estimated positions to which agents cannot have flown, and implausible reports."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np

from star_core.messages.arrays import Array, Mask, every, freeze, frozen
from star_core.messages.rotations import Transform
from star_core.safety.agents_in_the_way import MAX_REPORT_AGE
from star_core.safety.monitors import Report, Stage, TickState, Use
from star_core.toolkit.jit import compiled, records
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


STATE: Final = np.dtype([
    ("accepted_at", np.float64),  # s, of the last accepted position, like the next two
    ("accepted_position", np.float64, 3),  # m
    ("accepted_covariance", np.float64, (3, 3)),  # m²
    ("flown", np.float64, 3),  # m, since then, by the reported velocities
    ("reach", np.float64),  # m, that the agent can have flown since then besides
    ("unexplained", np.float64),  # m, recently
    ("rejected", np.bool_),  # whether its positions have been rejected since then
    ("corrected", np.bool_),  # whether its position has been corrected
    ("still_path", np.float64),  # m, that it reports since its estimate last moved
    ("reports", np.bool_),  # whether it has reported a velocity
    ("spoiled_until", np.float64),  # s
    ("above", np.float64),  # m, height in the map less the reported one
    ("last_position", np.float64, 3),  # m, in the last tick
    ("last_velocity", np.float64, 3),  # m/s, reported then
    ("accepted", np.bool_),  # whether the estimate of this tick is accepted
    ("stands", np.bool_),  # whether the last accepted position stays instead
    ("jump", np.float64, 3),  # m, s and m, of `_of_jump`; NaN without a new one
])  # fmt: skip
"""State of one agent in an `EstimateMonitor`."""


class EstimateMonitor:
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
        scene: The agents, and their speed limit.
        localizer: Named in reports.
    """

    after = Stage.LOCATED

    def __init__(self, scene: Scene, localizer: str) -> None:
        n = len(scene.agents)
        self._names = scene.names
        self._localizer = localizer
        self._speed = max(SPEED_RATIO * scene.limits.speed, MIN_PLAUSIBLE_SPEED)
        self._state = records(n, STATE)
        for name in ("accepted_position", "above", "last_position", "last_velocity"):
            self._state[name] = np.nan
        self._state["spoiled_until"] = -np.inf
        self._known_frames = Transform(  # the last ones
            np.array([agent.yaw for agent in scene.agents]),
            np.array([agent.start for agent in scene.agents]),
        )
        self._frames = Transform(np.zeros(n), np.zeros((n, 3)))  # accepted last
        self._last_time = 0.0  # s, of the last tick
        self._judge(0.0, *_nothing())  # compiled before the flight

    def check(self, state: TickState) -> Iterator[Report | Use]:
        """Yield the estimate without implausible positions, and reports of new ones.

        Agents whose frames are not finite have the last known ones.
        """
        estimate, telemetry = state.estimate, state.telemetry
        if estimate.map_from_odom is not self._known_frames:
            if not every(finite := estimate.map_from_odom.known):
                frames = estimate.map_from_odom.where(finite, self._known_frames)
                estimate = replace(estimate, map_from_odom=frames)
            self._known_frames = estimate.map_from_odom
        heard = telemetry.age <= MAX_REPORT_AGE
        velocity, position = telemetry.velocity, telemetry.position
        if estimate.heights is not None:  # over another surface than at the start
            position, velocity = position.copy(), velocity.copy()
            position[:, 2], velocity[:, 2] = estimate.heights.T
            freeze(position, velocity)
        stands = self._judge(
            float(estimate.time),
            estimate.position,
            estimate.covariance,
            estimate.valid,
            state.airborne,
            heard,
            velocity,
            position,
        )
        agents, self._last_time = self._state, estimate.time
        frames = estimate.map_from_odom
        if not every(agents["accepted"]):
            frames = frames.where(agents["accepted"], self._frames)
        self._frames = frames
        if stands:
            jump, column = agents["jump"], agents["stands"][:, None]
            for row in np.flatnonzero(~np.isnan(jump[:, 0])).tolist():
                yield Report("estimate", self._of_jump(row, *jump[row].tolist()), self._names[row])
            estimate = replace(
                estimate,
                position=np.where(column, agents["accepted_position"], estimate.position),
                velocity=np.where(column, 0.0, estimate.velocity),
                covariance=np.where(
                    column[..., None], agents["accepted_covariance"], estimate.covariance
                ),
                valid=agents["accepted"].copy(),
                map_from_odom=frames.where(agents["stands"], estimate.map_from_odom),
            )
        if estimate is not state.estimate:
            yield Use("estimate", estimate)

    def _judge(self, time: float, *tick: Any) -> bool:
        seconds = time - self._last_time
        return judge(time, seconds, self._speed, self._state, self._frames.yaw, *tick)

    def _of_jump(self, row: int, distance: float, seconds: float, plausible: float) -> str:
        """Return in words that a position is rejected after one that was accepted.

        Args:
            row: Of the agent.
            distance: From the last position that was accepted, m.
            seconds: Time since then, s.
            plausible: Greatest distance that would have been accepted, m; NaN if the estimate has
                not moved at all while the agent reported that it flew `distance`.
        """
        moved = f"moved {distance:.2f} m in {seconds:.2f} s, expected at most {plausible:.2f} m"
        if np.isnan(plausible):
            moved = f"did not change while it reported {distance:.2f} m of flight,"
        name = self._names[row]
        return f"{name} brakes: its estimated position {moved} from {self._localizer}"


def _nothing() -> tuple[Any, ...]:
    """Return an estimate of no agent, of the types that it has in flight."""
    columns = ((3,), np.float64), ((3, 3), np.float64), ((), np.bool_)
    position, covariance, valid = (frozen(np.zeros((0, *row), kind)) for row, kind in columns)
    unheard = np.zeros(0, np.bool_)
    return position, covariance, valid, unheard, unheard, position, position


@compiled
def judge(  # noqa: C901, PLR0912, PLR0913, PLR0915, PLR0917 -- the gate, in one pass
    time: float,
    seconds: float,
    top_speed: float,
    state: Any,
    yaw: Array,
    position: Array,
    covariance: Array,
    valid: Mask,
    airborne: Mask,
    heard: Mask,
    velocity: Array,
    height: Array,
) -> bool:
    """Accept or reject the estimate of each agent, as `EstimateMonitor` describes.

    Args:
        time: Of the estimate, s.
        seconds: Since the last tick, s.
        top_speed: Greatest plausible speed, m/s.
        state: (N,) `STATE` of each agent, which is updated.
        yaw: (N,) of the odometry frames that were accepted last, rad.
        position: (N, 3) m.
        covariance: (N, 3, 3) m².
        valid: (N,) agents that are located.
        airborne: (N,) agents in the air.
        heard: (N,) agents that are heard.
        velocity: (N, 3) that the agents report, m/s.
        height: (N, 3) positions that they report, m.

    Returns:
        Whether any agent keeps its last position.
    """
    any_stands = False
    for row in range(len(valid)):
        agent = state[row]
        vx, vy, vz = velocity[row, 0], velocity[row, 1], velocity[row, 2]
        if not heard[row]:
            vx = vy = vz = math.nan
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        agent.reports = agent.reports or math.isfinite(speed)
        if heard[row] and agent.reports and not speed <= top_speed:
            agent.spoiled_until = time + SPOILED_TIME
        spoiled = time < agent.spoiled_until
        if spoiled:
            vx = vy = vz = speed = math.nan
        if math.isfinite(speed):
            cos, sin = math.cos(yaw[row]), math.sin(yaw[row])
            agent.flown[0] += seconds * (cos * vx - sin * vy)
            agent.flown[1] += seconds * (sin * vx + cos * vy)
            agent.flown[2] += seconds * vz
        # one that is rejected can be elsewhere only by the error of its reports
        is_known = agent.rejected and math.isfinite(speed)
        agent.reach += seconds * (REPORT_ERROR * speed if is_known else top_speed)
        same = airborne[row] and math.isfinite(seconds * speed)
        for axis in range(3):
            same = same and position[row, axis] == agent.last_position[axis]
            agent.last_position[axis] = position[row, axis]
        new = (  # a report that repeats is an old one
            vx != agent.last_velocity[0]
            or vy != agent.last_velocity[1]
            or vz != agent.last_velocity[2]
        )
        agent.last_velocity[0], agent.last_velocity[1] = vx, vy
        agent.last_velocity[2] = vz
        path = seconds * speed if new else 0.0
        agent.still_path = agent.still_path + path if same else 0.0
        stuck = agent.still_path > MAX_STILL_PATH
        dx = position[row, 0] - agent.accepted_position[0] - agent.flown[0]
        dy = position[row, 1] - agent.accepted_position[1] - agent.flown[1]
        dz = position[row, 2] - agent.accepted_position[2] - agent.flown[2]
        moved = math.sqrt(dx * dx + dy * dy + dz * dz)
        before, now = 0.0, 0.0
        for axis in range(3):
            before += agent.accepted_covariance[axis, axis]
            now += covariance[row, axis, axis]
        shrunk = before - now if before > now else 0.0
        explained = agent.reach + CORRECTION_SIGMAS * math.sqrt(shrunk)
        carried = agent.unexplained * math.exp((agent.accepted_at - time) / FORGETTING_TIME)
        excess = carried + max(moved - explained, 0.0)
        correction = agent.corrected or now < CORRECTED_SHARE * before
        margin = JUMP_MARGIN if correction else UNCORRECTED_MARGIN
        over = position[row, 2] - height[row, 2] if heard[row] else math.nan
        jumped = abs(dz) > MAX_HEIGHT_JUMP and abs(over - agent.above) > MAX_HEIGHT_JUMP
        judged = (airborne[row] or agent.rejected) and valid[row]
        rejects = judged and (excess > margin or jumped or stuck)
        agent.jump[0] = math.nan
        if rejects and not agent.rejected:
            plausible = explained + margin - carried
            if jumped and plausible > MAX_HEIGHT_JUMP:
                plausible = MAX_HEIGHT_JUMP
            agent.jump[0] = agent.still_path if stuck else moved
            agent.jump[1] = time - agent.accepted_at
            agent.jump[2] = math.nan if stuck else plausible
        agent.accepted = valid[row] and not rejects and not spoiled
        if agent.accepted:
            agent.corrected, agent.rejected, agent.above = correction, False, over
            agent.accepted_at, agent.reach = time, 0.0
            agent.unexplained = excess if judged and math.isfinite(excess) else 0.0
            for axis in range(3):
                agent.flown[axis] = 0.0
                agent.accepted_position[axis] = position[row, axis]
                for other in range(3):
                    agent.accepted_covariance[axis, other] = covariance[row, axis, other]
        else:
            agent.rejected = rejects or agent.rejected
        located = math.isfinite(agent.accepted_position[0] + agent.accepted_position[1])
        located = located and math.isfinite(agent.accepted_position[2])
        agent.stands = rejects or (spoiled and located)
        any_stands = any_stands or agent.stands
    return any_stands
