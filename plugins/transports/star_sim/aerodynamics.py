"""The air around the drones: downwash, ground effect and wind, as a push once per cycle of 10 ms.

The drag of `star_sim.body` is linear in the velocity, so the force of moving air is drag times its
velocity, whatever the drone's own.
"""

from __future__ import annotations

import math

import numpy as np

from star_core import Array
from star_core.toolkit import subroutine
from star_sim.airframe import CYCLE, DRAG_XY, DRAG_Z, HEIGHT, INERTIA_XY, MASS
from star_sim.contact import SWEEP
from star_sim.drone import OFF, Record
from star_sim.powertrain import DRAG, MOMENT
from star_sim.sensors import gauss_markov, streams

# Downwash. The air below a quadrotor is a turbulent jet (Bauersfeld, Muller, Ziegler, Coletti and
# Scaramuzza, "Robotics meets Fluid Dynamics: A Characterization of the Induced Airflow below a
# Quadrotor as a Turbulent Jet", RA-L 2025): at a depth z its velocity goes with 1 / (z + ORIGIN),
# and falls off over its half width, which grows with SPREAD. The numbers are those of the
# implementation in GADEN: origin 5.817 and rate 0.07668, in units of the distance of the motors.
# The force is that of the dynamic pressure: it goes with the squared velocity, and with the thrust
# of the upper drone. Shi, Hönig, Yue and Chung (Neural-Swarm, ICRA 2020) measured its strength: 9 g
# between two Crazyflies of 34 g that hover 0.3 m above each other.
ORIGIN = 5.817 * 0.092  # m
SPREAD = 0.07668
MEASURED_DEPTH = 0.3  # m
MEASURED_SHARE = 9 / 34  # of the upper drone's thrust
PROFILE = math.sqrt(2.0) - 1.0  # makes the velocity half as great at the half width
DEPTH = 2.0  # m, up to which it is computed: a 30th of the thrust
RADIUS = 0.5  # m, up to which it is computed: less than a 500th of the thrust

# Ground effect: coefficient and radius of gym-pybullet-drones (``cf2x.urdf``), which has the form
# of Cheeseman and Bennett's law: thrust grows by COEFFICIENT (R / 4 h)² at a height h.
COEFFICIENT = 11.36859
PROPELLER_RADIUS = 0.0231348  # m
LOWEST = 0.25 * PROPELLER_RADIUS * math.sqrt(15 * COEFFICIENT / 4)  # m: it grows no more below

_KEY_REACH = RADIUS * math.hypot(*SWEEP[:2]) + DEPTH * SWEEP[2]  # m along SWEEP

X, Y, Z, THRUST, KEY, LOAD = range(6)
COLUMNS = 6  # of the table of `wash`

_STREAM = 7339


class Wind:
    """A constant wind with gusts: to each drone its own, equal along all axes.

    A gust is a first-order Gauss-Markov process, as the longitudinal gusts of the Dryden model are
    (MIL-F-8785C), in its steady state from the start.

    Args:
        velocity: (3,) in the map, m/s.
        gusts: Standard deviation along each axis, m/s.
        gust_time: Correlation time, s.
        seed: Of the flight.
        agents: Number of drones; each has its own random stream.
    """

    def __init__(
        self, velocity: list[float], gusts: float, gust_time: float, seed: int, agents: int
    ) -> None:
        self._velocity, self._std = np.array(velocity, float), gusts
        self._keep = math.exp(-CYCLE / gust_time)
        self._streams = streams(seed, _STREAM, agents)
        self._last = gusts * np.stack([stream.standard_normal(3) for stream in self._streams])

    def block(self, cycles: int) -> Array:
        """Return the velocities of the air in the next cycles, (cycles, N, 3) in the map, m/s."""
        draws = [stream.standard_normal((cycles, 3)) for stream in self._streams]
        drive = self._std * math.sqrt(1 - self._keep**2) * np.stack(draws, axis=1)
        gusts = gauss_markov(drive, self._keep, self._last)
        self._last = gusts[-1].copy()
        air: Array = gusts + self._velocity
        return air


@subroutine
def downwash(depth: float, squared: float, thrust: float) -> float:
    """Return the force of one drone's downwash on another, N, downwards.

    Args:
        depth: Of the lower drone below the upper one, m.
        squared: Square of their horizontal distance, m².
        thrust: Of the upper one, N.
    """
    far = ORIGIN + depth
    half_width = SPREAD * far
    shape = 1.0 / (1.0 + PROFILE * squared / (half_width * half_width))
    nearer = (ORIGIN + MEASURED_DEPTH) / far
    return MEASURED_SHARE * thrust * nearer * nearer * shape * shape * shape * shape


@subroutine
def wash(drones: Record, order: Record, keys: Record, near: Record) -> None:
    """Fill in the sum of the downwash on every drone.

    Args:
        drones: (N,) records.
        order: (N,) rows sorted by `keys`.
        keys: (N,) coordinate of each row along `star_sim.contact.SWEEP`.
        near: (N, COLUMNS) output, by row: LOAD is the force, N; the other columns are buffers, in
            the order of `order`.
    """
    n = len(drones)
    for index in range(n):
        row = order[index]
        at, thrust = drones[row].position, drones[row].thrust
        near[index, X], near[index, Y], near[index, Z] = at[0], at[1], at[2]
        near[index, THRUST] = thrust[0] + thrust[1] + thrust[2] + thrust[3]
        near[index, KEY] = keys[row]
        near[index, LOAD] = 0.0
    for first in range(n):
        for second in range(first + 1, n):
            if near[second, KEY] - near[first, KEY] > _KEY_REACH:
                break
            dx, dy = near[second, X] - near[first, X], near[second, Y] - near[first, Y]
            squared = dx * dx + dy * dy
            rise = near[second, Z] - near[first, Z]
            if squared < RADIUS * RADIUS and abs(rise) < DEPTH:
                upper, lower = (second, first) if rise > 0.0 else (first, second)
                force = downwash(abs(rise), squared, near[upper, THRUST])
                near[order[lower], LOAD] += force


@subroutine
def cushion(height: float) -> float:
    """Return the share by which the ground raises the thrust at a height of the propellers, m."""
    ratio = PROPELLER_RADIUS / (4.0 * max(height, LOWEST))
    return COEFFICIENT * ratio * ratio


@subroutine
def push(drone: Record, wind: Record, washed: Record, cascade: Record) -> None:
    """Change the velocity of one drone by the forces of the air over one cycle.

    A drone whose motors are off feels none: friction holds it on the floor.

    Args:
        drone: The drone.
        wind: (3,) velocity of the air in the map, m/s.
        washed: Its row of the table of `wash`; None without downwash and ground effect.
        cascade: Its controller, None for the ideal one: with another the air turns it too, as in
            `star_sim.powertrain.turn`.
    """
    if drone.mode == OFF:
        return
    qx, qy, qz, qw = drone.attitude[0], drone.attitude[1], drone.attitude[2], drone.attitude[3]
    bx = 2 * (qx * qz + qw * qy)  # the body's z axis in the map
    by = 2 * (qy * qz - qw * qx)
    bz = 1 - 2 * (qx * qx + qy * qy)
    drag = DRAG_XY if cascade is None else DRAG
    wx, wy, wz = wind[0], wind[1], wind[2]
    along = (DRAG_Z - drag) * (bx * wx + by * wy + bz * wz)
    down = 0.0
    if washed is not None:
        lift = drone.thrust[0] + drone.thrust[1] + drone.thrust[2] + drone.thrust[3]
        along += lift * cushion(drone.position[2] - drone.surface + HEIGHT)
        down = washed[LOAD]
    drone.velocity[0] += CYCLE / MASS * (along * bx + drag * wx)
    drone.velocity[1] += CYCLE / MASS * (along * by + drag * wy)
    drone.velocity[2] += CYCLE / MASS * (along * bz + drag * wz - down)
    if cascade is not None:
        ahead = (1 - 2 * (qy * qy + qz * qz)) * wx + 2 * (qx * qy + qw * qz) * wy
        ahead += 2 * (qx * qz - qw * qy) * wz
        aside = 2 * (qx * qy - qw * qz) * wx + (1 - 2 * (qx * qx + qz * qz)) * wy
        aside += 2 * (qy * qz + qw * qx) * wz
        drone.rates[0] -= CYCLE * MOMENT / INERTIA_XY * aside
        drone.rates[1] += CYCLE * MOMENT / INERTIA_XY * ahead
