"""Heights in the map from on-board heights that are measured over whatever is below."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import shapely

from star_core.messages.arrays import Array, Rows, frozen, some
from star_core.messages.telemetry import Odometry, Supervisor, Telemetry
from star_core.toolkit.jit import compiled, subroutine

if TYPE_CHECKING:
    from star_core.world.scene import Scene
    from star_core.world.world import Obstacle

# An on-board filter of heights (``kalman_core``, or `star_sim.estimator`) absorbs a step of what is
# below as an error of its height and its climb: the height makes a jump that its climb does not
# explain, and the climb a jump that no acceleration does.
LEAST_JUMP: Final = 0.015  # m between two samples: an edge of 4 cm; noise makes 1 to 2 mm
JUMP_PER_SQUARE_TIME: Final = 1.0  # m/s², in addition: acceleration between two samples
CLIMB_PER_JUMP: Final = 11.6  # 1/s, by a Kalman filter with the firmware's noise
SETTLED: Final = 0.25  # s after the last jump, from when the on-board height is right again
LONGEST: Final = 2.0  # s, of one crossing: then it is over, however the height changes

DEEPEST: Final = 0.5
"""How far below the floor, or above the drone, a surface may be measured, m. Beyond, a sample is no
measurement, and nothing follows from it: drones whose reports are random would climb by them."""

BEAM: Final = math.radians(13.5)  # half of the VL53L1X's field of view
REACH: Final = 3.0  # standard deviations of the position, within which edges are below
STEP_STD: Final = 0.03  # m, of a height that is reckoned over an edge, and
STEP_STD_PER_TIME: Final = 0.10  # m/s
GATE: Final = 3.0  # standard deviations from the next surface of the map, for another surface

TIME, HEIGHT, CLIMB, Z, VZ, OFFSET, BEGAN, JUMPED, BIAS, GROUND = range(10)
"""Columns of an agent's state: time (s), height (m) and climb (m/s) of its last sample, the same
corrected; what is added to its heights (m); begin and last jump of a crossing (s), or NaN; the
bias of its accelerometer that the ranger corrects (m/s²); and z of its odometry frame (m)."""
STATES: Final = 10
FLYING: Final = int(Supervisor.FLYING)
BIAS_RATE: Final = 0.5  # 1/s, at which it is estimated between crossings


@compiled
def follow(  # noqa: C901 -- the samples of all agents, in one pass
    state: Array,
    supervisor: Rows,
    agent: Rows,
    time: Array,
    height: Array,
    velocity: Array,
    corrected_height: Array,
    corrected_climb: Array,
) -> bool:
    """Correct samples of the on-board estimators, and carry each agent's state through them.

    Between the begin and the end of a crossing the heights are reckoned by the acceleration, which
    is what the climb changes by apart from the jumps.

    Args:
        state: (N, STATES) changed.
        supervisor: (N,) `Supervisor` bits; heights of agents that do not fly do not jump.
        agent: (K,) rows of the samples, each agent's in order of time.
        time: (K,) s.
        height: (K,) m in the odometry frame.
        velocity: (K, 3) m/s.
        corrected_height: (K,) the result, m.
        corrected_climb: (K,) the result, m/s.

    Returns:
        Whether an agent crosses an edge, or is over another surface than it started from.
    """
    for k in range(len(agent)):
        row = state[agent[k]]
        now, z, vz = time[k], height[k], velocity[k, 2]
        corrected_height[k], corrected_climb[k] = z, vz
        passed = now - row[TIME]
        if not math.isfinite(z + vz) or passed <= 0.0:
            continue
        if supervisor[agent[k]] & FLYING == 0:
            row[BEGAN] = math.nan
        elif math.isfinite(passed):
            jump = z - row[HEIGHT] - 0.5 * passed * (vz + row[CLIMB])
            before = row[OFFSET] if math.isnan(row[BEGAN]) else row[Z] - row[HEIGHT]
            if row[GROUND] + before - jump < -DEEPEST or z < -DEEPEST:  # no surface
                if passed < LONGEST:
                    continue
                row[BEGAN] = math.nan
            else:
                if abs(jump) > LEAST_JUMP + JUMP_PER_SQUARE_TIME * passed * passed:
                    if math.isnan(row[BEGAN]):
                        row[BEGAN], row[VZ] = row[TIME], row[CLIMB]
                        row[Z] = row[HEIGHT] + row[OFFSET]
                    row[JUMPED] = now
                unexplained = CLIMB_PER_JUMP * jump - passed * row[BIAS]
                if not math.isnan(row[BEGAN]):
                    reckoned = row[VZ] + vz - row[CLIMB] - unexplained
                    row[Z] += 0.5 * passed * (reckoned + row[VZ])
                    row[VZ] = reckoned
                else:
                    row[BIAS] += BIAS_RATE * unexplained
        row[TIME], row[HEIGHT], row[CLIMB] = now, z, vz
        if math.isnan(row[BEGAN]):
            row[Z], row[VZ] = z + row[OFFSET], vz
        corrected_height[k], corrected_climb[k] = row[Z], row[VZ]
    return _corrects(state)


@subroutine
def _corrects(state: Array) -> bool:
    """Return whether an agent crosses an edge, or is over another surface."""
    corrects = False
    for row in state:
        corrects = corrects or not math.isnan(row[BEGAN]) or row[OFFSET] != 0.0
    return corrects


class SurfaceHeights:
    """Follows the surfaces below agents, by the map and by the jumps of their heights.

    A jump begins a crossing, in which heights are reckoned without the ranger. After it, the agent
    is over that surface of the map which explains its height best, among those that its beam may
    meet: with the covariance of its position and the beam's width. If none does, it is over a
    surface that is not in the map: its height stays as reckoned, with a greater covariance, which
    widens the margins to others and to obstacles.

    Without jumps all values stay as they are.

    Args:
        scene: Agents and world.
        only_mapped: Whether an agent is never over a surface that is not in the map: where the
            on-board estimators know the map, positions that they receive may move heights too.
    """

    def __init__(self, scene: Scene, *, only_mapped: bool = False) -> None:
        n = len(scene.agents)
        self._agents, self._obstacles = scene.agents, scene.world.obstacles
        self._ground = np.array([agent.start[2] for agent in scene.agents])
        self._ceiling = float(scene.world.fence.high[2])
        self._only_mapped = only_mapped
        self._exact = scene.exact_odometry or not scene.heights_above_surface
        self._state = np.full((n, STATES), np.nan)
        self._state[:, [OFFSET, BIAS]] = 0.0
        self._state[:, GROUND] = self._ground
        self._doubt = np.zeros(n)  # m², variance by the surface
        self._zeros = frozen(np.zeros(n))
        if not self._exact:
            self._follow(frozen(np.zeros(n, np.int64)), Odometry.none())

    def correct(self, telemetry: Telemetry, position: Array, covariance: Array) -> SurfaceReport:
        """Return what the agents report, with heights over the surfaces from which they started.

        Args:
            telemetry: Reported.
            position: (N, 3) last estimate in the map, m.
            covariance: (N, 3, 3) of it, m².
        """
        if self._exact:
            return SurfaceReport(telemetry, self._zeros, self._zeros)
        state, odometry = self._state, telemetry.odometry
        corrects, height, climb = self._follow(telemetry.state, odometry)
        if not corrects:
            return SurfaceReport(telemetry, self._zeros, self._doubt)
        crossing = ~np.isnan(state[:, BEGAN])
        velocity = np.array(odometry.velocity)
        velocity[:, 2] = climb
        heard = np.isfinite(state[:, TIME])
        offset = np.where(heard, state[:, Z] - state[:, HEIGHT], 0.0)
        moved, moves = np.array(telemetry.position), np.array(telemetry.velocity)
        moved[:, 2] += offset
        moves[:, 2] = np.where(crossing, state[:, VZ], moves[:, 2])
        messages = []
        now = telemetry.time
        doubt = self._doubt + np.where(crossing, _reckoned_variance(now - state[:, BEGAN]), 0.0)
        for row in np.flatnonzero(crossing).tolist():
            settled = state[row, TIME] - state[row, JUMPED] > SETTLED
            if settled or state[row, TIME] - state[row, BEGAN] > LONGEST:
                messages += self._land_on(row, position[row], covariance[row])
        corrected = replace(
            telemetry,
            position=moved,
            velocity=moves,
            odometry=replace(odometry, height=height, velocity=velocity),
        )
        return SurfaceReport(
            corrected,
            offset,
            doubt,
            tuple(messages),
            frozen(np.column_stack([moved[:, 2], moves[:, 2]])) if some(offset != 0.0) else None,
        )

    def _follow(self, supervisor: Rows, odometry: Odometry) -> tuple[bool, Array, Array]:
        """Call `follow`; return whether it corrects samples, and their heights and climbs."""
        k = len(odometry.agent)
        height, climb = np.empty(k), np.empty(k)
        corrects = follow(
            self._state,
            supervisor,
            odometry.agent,
            odometry.time,
            odometry.height,
            odometry.velocity,
            height,
            climb,
        )
        return corrects, height, climb

    def _land_on(self, row: int, position: Array, covariance: Array) -> list[str]:
        """End a crossing: set what is added to the heights, and their variance."""
        state = self._state[row]
        variance = _reckoned_variance(state[TIME] - state[BEGAN])
        state[BEGAN] = np.nan
        measured = self._ground[row] + state[Z] - state[HEIGHT]  # m, height of the surface
        if measured > self._ceiling:
            return []
        above = max(state[HEIGHT], 0.0)
        spread = math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
        spread = math.hypot(spread, above * math.tan(BEAM))
        tops = {0.0: 1.0}  # probability of each surface, by its height
        for obstacle in self._obstacles:
            top, distance = obstacle.height[1], _inside(obstacle, position)
            if top <= self._ground[row] + state[Z] and distance > -REACH * spread:
                tops[top] = max(tops.get(top, 0.0), _within(distance / spread))
        surfaces = np.array(list(tops))
        off = (surfaces - measured) ** 2 / variance
        weight = np.array(list(tops.values())) * np.exp(-0.5 * (off - off.min()))
        best = int(weight.argmax())
        weight /= weight.sum()
        if off[best] > GATE**2 and not self._only_mapped:
            state[OFFSET] = measured - self._ground[row]
            self._doubt[row] = variance
            x, y = position[:2].tolist()
            return [
                f"{self._agents[row].name} flies over a surface {measured:.2f} m high at "
                f"[{x:.2f}, {y:.2f}] that is not in the map"
            ]
        state[OFFSET] = surfaces[best] - self._ground[row]
        self._doubt[row] = float(weight @ (surfaces - surfaces[best]) ** 2)
        return []


class SurfaceReport(NamedTuple):
    """What agents report, corrected.

    Attributes:
        telemetry: With heights over the surfaces from which the agents started; the same object if
            nothing is corrected.
        offset: (N,) added to the heights of the odometry frames, m.
        variance: (N,) of the heights by the surfaces, m².
        messages: Surfaces that are not in the map.
        heights: For `Estimate.heights`; None if nothing is corrected.
    """

    telemetry: Telemetry
    offset: Array
    variance: Array
    messages: tuple[str, ...] = ()
    heights: Array | None = None


def _reckoned_variance(duration: Array) -> Array:
    """Return the variance of a height reckoned without a ranger for a `duration`, s: m²."""
    variance: Array = (STEP_STD + STEP_STD_PER_TIME * duration) ** 2
    return variance


def _inside(obstacle: Obstacle, position: Array) -> float:
    """Return how far within an obstacle's outline a position is, m; negative outside."""
    x, y = position[:2].tolist()
    beside = obstacle.gaps((x, y, obstacle.height[1]))[0]
    if beside > 0.0:
        return -beside
    point = shapely.Point(x, y)
    return max(
        float(shapely.Polygon(piece).exterior.distance(point)) for piece in obstacle.polygons
    )


def _within(deviations: float) -> float:
    """Return the probability that a normal deviate is less."""
    return 0.5 * math.erfc(-deviations / math.sqrt(2.0))
