"""Positioning systems with receivers on board, by which the estimators know the map.

What is simulated of each, and from where its numbers are, is in `ERRORS`. With a Flow deck heights
stay those of its ranger, and receivers correct position and heading; without, they correct height,
velocity and tilt too.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from star_core import Array, Corrections, Mask, Rows, Scene, World
from star_core.toolkit import (
    SYSTEMS,
    Fault,
    quaternion_from_euler,
    received,
    yaw_from_quaternion,
)
from star_sim.airframe import STEP
from star_sim.drone import Drones
from star_sim.fusion import Fusion
from star_sim.inertial_fusion import InertialFusion, Ranges
from star_sim.positioning import AXES, failing

_STREAM: Final = 7351
SINGLE: Final = 3.0  # assumed: how much more positions err by one base station than by several
MIN_GEOMETRY: Final = 1e-3  # of the ranges' geometry: anchors in a plane do not give its normal
WALL_REACH: Final = 0.3  # m from a wall, at which its effect on ranges has decayed; assumed
RANGE_STD: Final = 0.25  # m, that the firmware assumes of a range (``lpsTwrTag.c``)


class Errors(NamedTuple):
    """Errors of a positioning system.

    Attributes:
        rate: Positions of each drone, 1/s.
        bias: Standard deviation, m: of the position along each axis by the geometry of each base
            station, constant; of each range; or of a pose.
        change_time: Time constant with which it changes, s.
        noise: Standard deviation of independent errors of positions or ranges, m.
        wall: Bias of a range near a wall, m.
        yaw_bias: Standard deviation of a constant error of headings, rad; NaN measures none.
        latency: Until a position is used, s.
        assumed: Standard deviation that the on-board estimators assume along each axis, m.
    """

    rate: float
    bias: float
    change_time: float
    noise: float
    wall: float
    yaw_bias: float
    latency: float
    assumed: float


ERRORS: Final[Mapping[str, Errors]] = {
    # Taffanel et al., "Lighthouse Positioning System: Dataset, Accuracy, and Precision for UAV
    # Research", arXiv 2104.11523: errors of centimetres, constant in time and less than 1 mm of
    # jitter. With 2 cm of each base station the mean error of two is 2.3 cm. Heading: assumed.
    "lighthouse": Errors(30.0, 0.02, math.inf, 0.001, 0.0, math.radians(1.0), 0.0, 0.01),
    # Decawave's DW1000: ranges within 10 cm, read as one deviation of a bias that changes over
    # decimetres (Ledergerber and D'Andrea, "Ultra-wideband range measurement model with Gaussian
    # processes", CCTA 2017), here in time. Noise, and more bias near walls: assumed.
    "loco": Errors(20.0, 0.1, 3.0, 0.05, 0.05, math.nan, 0.0, 0.1),
    # Motion capture, sent by another program: as the option `positioning` assumes it.
    "poses": Errors(50.0, 0.002, 1.0, 0.0005, 0.0, math.radians(0.5), 0.02, 0.01),
}


class Onboard:
    """Measures the positions of drones where they receive a positioning system.

    Args:
        scene: World and seed.
        fusion: Of the on-board estimators: with or without a Flow deck.
        system: Name in `ERRORS`.

    Attributes:
        faults: That are simulated.
        receives: (N,) whose receivers work.
        next_step: Number of the step of 2 ms before which the next measurement is taken.
    """

    def __init__(self, scene: Scene, fusion: Fusion | InertialFusion, *, system: str) -> None:
        n = len(scene.agents)
        self._use: Callable[[Drones, Any, float], None] = fusion.take
        self._ranging = system == "loco" and isinstance(fusion, InertialFusion)
        self._world, self._errors, self._name = scene.world, ERRORS[system], system
        self._system = SYSTEMS.get(system)
        beacons = () if self._system is None else self._system.beacons(scene.world)
        self._beacons = np.array([each.position for each in beacons], float).reshape(-1, AXES)
        self._random = np.random.default_rng([scene.seed, _STREAM])
        shape = (n, len(beacons)) if system == "loco" else (n, AXES)
        self._bias = self._errors.bias * self._random.standard_normal(shape)
        stations = self._random.standard_normal((len(beacons), AXES))
        self._geometry = self._errors.bias * stations  # (K, 3) m
        yaw_bias = np.nan_to_num(self._errors.yaw_bias) * self._random.standard_normal()
        self._yaw_bias = float(yaw_bias)
        self._keep = math.exp(-1 / (self._errors.rate * self._errors.change_time))
        self._taken = 0
        self._late: deque[tuple[float, Corrections | Ranges]] = deque()  # s, when it is used
        self.faults: Sequence[Fault] = ()
        self.receives: Mask = np.ones(n, np.bool_)
        self.next_step = 0

    def take(self, drones: Drones, step: int) -> None:
        """Measure the drones if a measurement is due before a step, and correct their estimates."""
        now = step * STEP
        if step >= self.next_step:
            self._taken += 1
            self.next_step = math.ceil(self._taken / self._errors.rate / STEP - 1e-6)
            self._late.append((now + self._errors.latency, self.measured(drones, now)))
        if self._late and self._late[0][0] <= now + STEP / 2:
            self._use(drones, self._late.popleft()[1], now)

    def measured(self, drones: Drones, now: float) -> Corrections | Ranges:
        """Return positions of the drones that receive the system, or their ranges; map frame."""
        errors = self._errors
        fresh = math.sqrt(1 - self._keep**2) * errors.bias
        self._bias = self._keep * self._bias + fresh * self._random.standard_normal(
            self._bias.shape
        )
        noise = errors.noise * self._random.standard_normal(self._bias.shape)
        position = np.array(drones["position"])
        offset, lost = failing(self.faults, len(position), now, self._random)
        if self._system is None:
            located, error = np.ones(len(position), np.bool_), self._bias + noise
        else:
            heard = received(self._world, self._system, position)
            located = heard.sum(axis=1) >= self._system.needed
            if self._name == "loco":
                wall = errors.wall * np.exp(-nearest_surface(self._world, position) / WALL_REACH)
                ranged = self._bias + noise + wall[:, None]
                if self._ranging:
                    rows = np.flatnonzero(located & self.receives & ~lost)
                    return self._ranges(rows, position + offset, heard, ranged)
                error = self._by_ranges(position, heard, ranged)
            else:
                count = np.maximum(heard.sum(axis=1), 1)[:, None]
                error = heard @ self._geometry / count + noise
                error[count[:, 0] == 1] *= SINGLE
        rows = np.flatnonzero(located & self.receives & ~lost & np.isfinite(error).all(axis=1))
        yaw = yaw_from_quaternion(drones["attitude"][rows]) + self._yaw_bias
        yaw_std = math.inf if math.isnan(errors.yaw_bias) else errors.yaw_bias
        return Corrections(
            agent=rows,
            position=position[rows] + error[rows] + offset[rows],
            attitude=quaternion_from_euler(0 * yaw, 0 * yaw, yaw),
            position_deviation=np.full(len(rows), errors.assumed),
            attitude_deviation=np.full(len(rows), yaw_std),
        )

    def _ranges(self, rows: Rows, position: Array, heard: Mask, error: Array) -> Ranges:
        """Return the ranges of some drones to the anchors that they hear, with errors (N, K), m."""
        away = np.linalg.norm(position[:, None] - self._beacons, axis=-1)
        distance = np.where(heard, away + error, np.nan)
        return Ranges(rows, self._beacons, distance[rows], RANGE_STD)

    def _by_ranges(self, position: Array, heard: Mask, ranged: Array) -> Array:
        """Return the errors of positions, (N, 3) m, that errors of ranges cause, (N, K) m.

        It is the least-squares solution: anchors near a plane give a poor position across it.
        """
        error = np.full((len(position), AXES), np.nan)
        for row in np.flatnonzero(heard.sum(axis=1) >= AXES):
            towards = position[row] - self._beacons[heard[row]]
            towards /= np.linalg.norm(towards, axis=1, keepdims=True)
            solved = np.linalg.lstsq(towards, ranged[row, heard[row]], rcond=MIN_GEOMETRY)[0]
            error[row] = solved
        return error


def nearest_surface(world: World, points: Array) -> Array:
    """Return the distance of points to the nearest wall of the fence or of an obstacle: (T,) m.

    Args:
        world: Of the flight.
        points: (T, 3) map frame, m.
    """
    low, high = np.array(world.fence.low)[:2], np.array(world.fence.high)[:2]
    gaps = np.concatenate([points[:, :2] - low, high - points[:, :2]], axis=1).min(axis=1)
    nearest: Array = np.maximum(gaps, 0.0)
    if world.obstacles:
        import shapely

        at = shapely.points(points[:, :2])
        for obstacle in world.obstacles:
            for polygon in map(shapely.Polygon, obstacle.polygons):
                nearest = np.minimum(nearest, shapely.distance(polygon, at))
    return nearest
