"""The last check before setpoints are sent: geofence, speed limit and braking distances."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core.geometry.neighbours import Pairs
from star_core.messages.arrays import Array, Mask, Rows
from star_core.messages.events import Corrected
from star_core.messages.position_margin import MAX_MARGIN_RATIO, WALL_RADIUS, position_margin
from star_core.messages.rotations import Transform
from star_core.messages.state import Estimate, Setpoint, with_possible_positions
from star_core.safety.braking import (
    BRAKING_GAIN,
    LAG,
    YIELDING,
    approach_speed,
    slow_down,
)
from star_core.safety.walls import Walls, brake_for_walls, vertical_limits, walls
from star_core.toolkit.jit import compiled, subroutine
from star_core.toolkit.tracking import MAX_LEAD, TRACKING_GAIN
from star_core.world.scene import Scene

MIN_CORRECTION: Final = 0.05
"""Smallest change of a velocity that is reported as a correction, m/s."""

LEAD_AT_REST: Final = 0.05
"""Distance at which a position may be from an agent whose velocity is 0, m."""


class SafetyFilter:
    """Corrects setpoints from which an agent could not brake in time.

    A velocity is safe if from it the agent can brake inside the geofence and outside the ellipsoid
    of the separations around every other agent; two agents that are both steered share the braking.
    The distance to the ellipsoid is the first-order one, along its gradient: the exact distance is
    not less. With the remaining distance x and the speed c at which it shrinks now, a setpoint may
    let it shrink by ``BRAKING_GAIN (x - LAG c)``: a drone that follows setpoints with that lag
    comes to rest without overshoot. Nor may it be faster than what the mission's acceleration stops
    within x. Agents outside the fence or too close to another are therefore moved away.

    The horizontal separation of two agents grows by the margins for their uncertain positions,
    which yield: see `yielding_margin`. So do the distances to the sides of the fence; and
    to obstacles beside agents, which are left to planner and avoider where positions are exact.
    Below and above obstacles all agents brake, since a path that climbs or sinks beside one leads
    into it once others hold the agent back. Setpoints are corrected by as little as possible; if
    the corrections for several neighbors do not converge, agents stop.

    Attributes:
        reach: Distance beyond which agents need not brake for each other, m.
    """

    def __init__(self, scene: Scene) -> None:
        self._fence = np.array([scene.world.fence.low, scene.world.fence.high])
        self._walls = walls(scene.world.obstacles)
        self._limits = limits = scene.limits
        self._period = scene.period
        closing = 2 * limits.speed
        duration = LAG + max(1 / BRAKING_GAIN, scene.period + closing / (4 * limits.acceleration))
        room = closing * duration
        wide = math.dist(scene.world.fence.low, scene.world.fence.high)
        most = 1 + MAX_MARGIN_RATIO if limits.uncertainty_margin else 1.0  # over that without one
        widest = max(most * limits.separation, limits.vertical_separation)
        self.reach = widest + min(1.5 * room, wide)  # some approach faster than allowed
        self._warm_up()

    def filter(
        self, estimate: Estimate, safe: Setpoint, planned: Setpoint, near: Pairs
    ) -> tuple[Setpoint, Corrected]:
        """Return the setpoint to send, and the agents whose setpoints were changed.

        Args:
            estimate: Of the agents' positions.
            safe: The avoider's setpoint. Its inactive rows get zero velocity; without a setpoint
                the drone would fall.
            planned: Its active rows are sent.
            near: Pairs of agents within `reach`, at least.
        """
        n, limits = len(planned.yaw), self._limits
        possible, requested = with_possible_positions(estimate, planned)
        if possible is not estimate:
            _, safe = with_possible_positions(estimate, safe)
            near = Pairs.of(possible.position, self.reach)
        near = near.within(self.reach if limits.separation > 0 else 0.0)
        velocity, yaw = np.empty(safe.velocity.shape), np.empty(len(safe.yaw))
        changed = np.empty((4, len(yaw)), np.bool_)
        correct(
            velocity,
            yaw,
            changed,
            safe.velocity,
            safe.yaw,
            safe.active,
            requested.yaw,
            requested.active,
            possible.position,
            possible.velocity,
            position_margin(possible.covariance, limits.uncertainty_margin, WALL_RADIUS),
            position_margin(possible.covariance, limits.uncertainty_margin, limits.separation / 2),
            near.first,
            near.second,
            self._walls,
            self._fence,
            limits.speed,
            limits.acceleration,
            limits.separation,
            limits.vertical_separation,
            self._period,
        )
        sent = Setpoint.made(velocity[:n].copy(), yaw[:n].copy(), planned.active)
        return sent, Corrected(*changed[:, :n])

    def keep_trajectories(self, safe: Setpoint, planned: Setpoint, estimate: Estimate) -> Setpoint:
        """Return a setpoint with the trajectories of the agents whose velocity is as planned.

        A drone that flies to a position does so whatever its velocity, by which it has been judged.
        So the position must be inside the fence, and as near as that velocity leads.

        Args:
            safe: The setpoint to send.
            planned: The setpoint before monitors, avoider and filter.
            estimate: Of the agents' positions.
        """
        if planned.position is None:
            return safe
        followed = planned.followed() & safe.active
        followed &= (np.abs(safe.velocity - planned.velocity) <= TOLERANCE).all(axis=1)
        low, high = self._fence
        followed &= ((planned.position >= low) & (planned.position <= high)).all(axis=1)
        away = planned.position - estimate.position
        speed = np.sqrt(np.vecdot(safe.velocity, safe.velocity))
        near = np.minimum(LEAD_AT_REST + speed / TRACKING_GAIN, MAX_LEAD)
        followed &= np.vecdot(away, away) <= near**2
        return safe.following(planned, followed)

    def _warm_up(self) -> None:
        """Compile the kernels, or load them from disk, before the flight."""
        two, level, both = np.zeros((2, 3)), np.zeros(2), np.ones(2, np.bool_)
        frames, setpoint = Transform(level, two), Setpoint(two, level, both)
        estimate = Estimate(0.0, two, two, level, np.zeros((2, 3, 3)), both, frames)
        self.filter(estimate, setpoint, setpoint, Pairs.of(estimate.position, self.reach))


MAX_ITERATIONS: Final = 30
"""Corrections of agents that approach each other, before those that still do so stop."""

TOLERANCE: Final = 1e-3
"""Excess of the closing speed that is not corrected, m/s."""


@compiled
def correct(  # noqa: C901, PLR0913, PLR0917 -- numba takes plain arguments apart quickest
    apart: Array,
    yaw: Array,
    changed: Mask,
    safe: Array,
    safe_yaw: Array,
    has_safe: Mask,
    planned_yaw: Array,
    active: Mask,
    position: Array,
    velocity: Array,
    wall_margin: Array,
    margin: Array,
    first: Rows,
    second: Rows,
    wall: Walls,
    fence: Array,
    speed: float,
    brakes: float,
    separation: float,
    vertical_separation: float,
    period: float,
) -> None:
    """Compute the setpoints to send, as `SafetyFilter` describes them.

    Args:
        apart: (N, 3) output: velocities to send, m/s.
        yaw: (N,) output: headings to send, rad.
        changed: (4, N) output: as the columns of `Corrected`, in their order.
        safe: (N, 3) the avoider's velocities, m/s.
        safe_yaw: (N,) its headings, rad.
        has_safe: (N,) its active rows.
        planned_yaw: (N,) the planner's headings, rad.
        active: (N,) agents that are steered.
        position: (N, 3) m.
        velocity: (N, 3) current velocities, m/s; what is not finite counts as at rest.
        wall_margin: (N,) to obstacles and fence, for each agent's uncertain position, m.
        margin: (N,) to other agents, likewise, m.
        first: (P,) one of every two agents that are near each other.
        second: (P,) the other.
        wall: The pieces of the obstacles.
        fence: (2, 3) its lowest and its highest corner, m.
        speed: Greatest speed, m/s.
        brakes: Greatest deceleration, m/s².
        separation: Horizontal semi-axes of the ellipsoid around an agent that others keep free, m.
        vertical_separation: Its vertical semi-axis, m.
        period: Of the ticks, s.
    """
    n = len(active)
    flown, requested, slowed = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    beside, inside, vertical = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 2))
    for row in range(n):
        commanded = has_safe[row] and active[row]
        yaw[row] = safe_yaw[row] if commanded else planned_yaw[row]
        squared = 0.0
        for axis in range(3):
            fast = velocity[row, axis]
            flown[row, axis] = fast if math.isfinite(fast) else 0.0
            requested[row, axis] = safe[row, axis] if commanded else 0.0
            squared += requested[row, axis] * requested[row, axis]
        share = speed / max(math.sqrt(squared), speed) if squared > speed * speed else 1.0
        for axis in range(3):
            slowed[row, axis] = beside[row, axis] = requested[row, axis] * share
        if active[row] and wall_margin[row] > 0.0:
            room = wall_margin[row]
            brake_for_walls(beside, position, flown, row, room, wall, fence, speed, brakes, period)
        if active[row]:
            lowest, highest = vertical_limits(position, flown, row, wall, brakes, period)
            vertical[row, 0], vertical[row, 1] = lowest, highest  # a tuple at once takes 1.5 s
            beside[row, 2] = min(max(beside[row, 2], vertical[row, 0]), vertical[row, 1])
        for axis in range(3):
            inside[row, axis] = beside[row, axis]
        if active[row]:
            bound(inside, position, flown, row, fence, speed, brakes, period)
        for axis in range(3):
            apart[row, axis] = inside[row, axis] if active[row] else flown[row, axis]
    if len(first):
        pairs, motion = (first, second, margin), (speed, brakes, period)
        sizes = (separation, vertical_separation)
        separate(apart, position, flown, active, pairs, (fence, vertical), sizes, motion)
    for row in range(n):
        changed[0, row] = active[row] and differ(inside, beside, row)
        changed[1, row] = active[row] and differ(slowed, requested, row)
        changed[2, row] = active[row] and differ(apart, inside, row)
        changed[3, row] = active[row] and differ(beside, slowed, row)
        for axis in range(3):
            if not active[row]:
                apart[row, axis] = inside[row, axis]


@subroutine
def differ(first: Array, second: Array, row: int) -> bool:
    """Return whether two velocities of an agent differ by more than `MIN_CORRECTION`."""
    most = 0.0
    for axis in range(3):
        most = max(most, abs(first[row, axis] - second[row, axis]))
    return most > MIN_CORRECTION


@subroutine
def separate(
    apart: Array,
    position: Array,
    flown: Array,
    active: Mask,
    pairs: tuple[Rows, Rows, Array],
    bounds: tuple[Array, Array],
    sizes: tuple[float, float],
    motion: tuple[float, float, float],
) -> None:
    """Change velocities of agents to such from which they can brake before each other.

    The excess of a closing speed is shared equally by the two agents. Corrections are repeated,
    since each can bring an agent too close to another; agents that still violate a constraint then
    stop.

    Args:
        apart: (N, 3) velocities with which agents stay inside the bounds, m/s; active rows are
            changed, the others are those that the agents fly.
        position: (N, 3) m.
        flown: (N, 3) current velocities, m/s.
        active: (N,) agents that are steered; the others keep their velocity.
        pairs: (P,) rows of every two agents that are near each other, and (N,) the margins for
            uncertain positions, m.
        bounds: (2, 3) lowest and highest corner of the fence, m, and (N, 2) least and greatest
            vertical velocity above and below obstacles, m/s.
        sizes: Horizontal and vertical semi-axis of the ellipsoid, m.
        motion: Greatest speed, m/s, greatest deceleration, m/s², and period of the ticks, s.
    """
    first, second, margin = pairs
    fence, vertical = bounds
    separation, vertical_separation = sizes
    speed, brakes, period = motion
    direction, allowed = np.empty((len(first), 3)), np.empty(len(first))
    flat = separation / vertical_separation
    for pair in range(len(first)):
        agent, other = first[pair], second[pair]
        steered = int(active[agent]) + int(active[other])
        room, approach = direct(direction, pair, agent, other, position, flown, separation, flat)
        wide = separation + margin[agent] + margin[other]
        if wide > separation and room > 0.0:
            least, flatter = YIELDING * room, wide / vertical_separation
            room, approach = direct(direction, pair, agent, other, position, flown, wide, flatter)
            room = max(room, least)
        most = approach_speed(room, approach, brakes * max(1, steered), period)
        allowed[pair] = most if steered > 0 else math.inf
    change, times = np.empty((len(apart), 3)), np.empty(len(apart))
    for iteration in range(MAX_ITERATIONS + 1):
        if not corrections(change, times, apart, active, first, second, direction, allowed):
            return
        for row in range(len(active)):
            if times[row] > 0.0 and active[row]:
                for axis in range(3):
                    apart[row, axis] += change[row, axis] / times[row]
                slow_down(apart, row, speed)
                bound(apart, position, flown, row, fence, speed, brakes, period)
                apart[row, 2] = min(max(apart[row, 2], vertical[row, 0]), vertical[row, 1])
                if iteration == MAX_ITERATIONS:
                    for axis in range(3):
                        apart[row, axis] = 0.0


@subroutine
def corrections(
    change: Array,
    times: Array,
    velocity: Array,
    active: Mask,
    first: Rows,
    second: Rows,
    direction: Array,
    allowed: Array,
) -> bool:
    """Fill in the sum of each agent's corrections and their number; return whether there are any.

    Args:
        change: (N, 3) output: sum of the corrections, m/s.
        times: (N,) output: number of corrections.
        velocity: (N, 3) m/s.
        active: (N,) agents that are steered.
        first: (P,) one of every two agents that are near each other.
        second: (P,) the other.
        direction: (P, 3) unit vector from the second to the first.
        allowed: (P,) greatest closing speed, m/s.
    """
    for row in range(len(times)):
        times[row] = 0.0
        for axis in range(3):
            change[row, axis] = 0.0
    has_corrections = False
    for pair in range(len(first)):
        agent, other = first[pair], second[pair]
        approach = 0.0
        for axis in range(3):
            approach += direction[pair, axis] * (velocity[other, axis] - velocity[agent, axis])
        excess = approach - allowed[pair]
        if excess > TOLERANCE:
            has_corrections = True
            times[agent] += 1.0
            times[other] += 1.0
            share = excess / (int(active[agent]) + int(active[other]))
            for axis in range(3):
                change[agent, axis] += share * direction[pair, axis]
                change[other, axis] -= share * direction[pair, axis]
    return has_corrections


@subroutine
def direct(
    direction: Array,
    pair: int,
    agent: int,
    other: int,
    position: Array,
    flown: Array,
    separation: float,
    flat: float,
) -> tuple[float, float]:
    """Fill in the unit vector that leads out of an ellipsoid; return room and closing speed.

    With heights multiplied by `flat` the ellipsoid around `other` is a sphere, and the room of
    `agent` outside of it is a difference of distances. The direction is the gradient of that
    distance, and the room is divided by the length of the gradient, so both are in metres of the
    map. Two agents at the same position are taken to be side by side along x.

    Args:
        direction: (P, 3) output: row `pair` is filled in.
        pair: Row.
        agent: Row of one agent.
        other: Row of the other.
        position: (N, 3) m.
        flown: (N, 3) current velocities, m/s.
        separation: Horizontal semi-axes of the ellipsoid, m.
        flat: Ratio of these to the vertical one.
    """
    squared, steep, approach = 0.0, 0.0, 0.0
    for axis in range(3):
        scale = flat if axis == 2 else 1.0  # noqa: PLR2004 -- z
        offset = scale * (position[agent, axis] - position[other, axis])
        direction[pair, axis] = scale * offset
        squared += offset * offset
        steep += direction[pair, axis] * direction[pair, axis]
    if steep == 0.0:
        direction[pair, 0] = steep = 1.0
    for axis in range(3):
        direction[pair, axis] /= math.sqrt(steep)
        approach += direction[pair, axis] * (flown[other, axis] - flown[agent, axis])
    distance = math.sqrt(squared)
    gradient = math.sqrt(steep) / distance if distance > 0.0 else 1.0
    return (distance - separation) / gradient, approach


@subroutine
def bound(
    velocity: Array,
    position: Array,
    flown: Array,
    row: int,
    fence: Array,
    speed: float,
    brakes: float,
    period: float,
) -> None:
    """Change one velocity to one from which the agent can brake before the fence.

    An agent that leaves the fence fast, as in a fall, returns within the greatest speed too.
    """
    for axis in range(3):
        coordinate, fast = position[row, axis], flown[row, axis]
        up = approach_speed(fence[1, axis] - coordinate, fast, brakes, period)
        down = approach_speed(coordinate - fence[0, axis], -fast, brakes, period)
        velocity[row, axis] = min(max(velocity[row, axis], min(-down, up)), max(up, -down))
    slow_down(velocity, row, speed)
