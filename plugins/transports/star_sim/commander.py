"""The on-board commander: take-off, landing, go-to, stop, and velocity setpoints.

Guaranteed behavior, as in the firmware:

* A command starts a trajectory at once, and COMMANDER_FINISHED is clear until it ends. Commands
  override setpoints, and setpoints override commands, immediately.
* A take-off ends when COMMANDER_FINISHED is set. The drone then hovers for `HOVER_TIME`; if no
  command and no setpoint has taken over by then, it descends at `DESCENT_SPEED` to where it
  started, and stands there with its motors on. The transport ``radio`` has take-offs fly the same.
* A landing ends when COMMANDER_FINISHED is set, at which the motors stop; the drone counts as
  landed when FLYING is clear as well, 2 s later. A new take-off may follow at any time.
* An uploaded trajectory is flown piece by piece, and ends when COMMANDER_FINISHED is set. The drone
  then hovers and descends as after a take-off. Any command or setpoint that overrides it drops its
  remaining pieces.
* After a go-to the drone hovers until its battery is empty.
* STOP stops the motors at once without locking. ARM has no effect: brushed Crazyflies are armed.
* 0.5 s after the last setpoint the drone brakes and levels; after 2 s its motors stop and it is
  LOCKED until the end of the simulation (``COMMANDER_WDT`` in the firmware's ``supervisor.c``).
* A locked or crashed drone ignores commands.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from star_core import Array, Command, Order, Rows
from star_core.toolkit import compiled, polynomial, subroutine, wrap_angle
from star_sim.airframe import CYCLE
from star_sim.drone import DEMAND, OFF, TRAJECTORY, VELOCITY, Drones, Record
from star_sim.position import wrap

if TYPE_CHECKING:
    from star_core import Mask

LEVEL_AFTER = 0.5  # s without a setpoint
LOCK_AFTER = 2.0  # s without a setpoint
MOST_TURN = 1.5  # rad, by which the commanded yaw may run ahead of the drone

# The last four coefficients of a polynomial of order 7 on [0, 1], from what its end lacks in
# value, slope, curvature and third derivative when the first four are given.
_ENDING = np.linalg.inv(
    np.array([[1, 1, 1, 1], [4, 5, 6, 7], [12, 20, 30, 42], [24, 60, 120, 210]], float)
)

_polynomial = subroutine(polynomial)


@subroutine
def follow(drone: Record, now: float) -> None:
    """Set the reference of one drone at mission time `now`, s."""
    if drone.mode == TRAJECTORY and drone.finished == 0:
        _follow_trajectory(drone, (now - drone.trajectory_start) / drone.trajectory_duration)
    elif drone.mode == VELOCITY:
        silence = now - drone.setpoint_time
        if silence > LOCK_AFTER:
            drone.mode = OFF
            drone.locked = 1
        elif silence > LEVEL_AFTER:
            for axis in range(3):
                drone.reference_velocity[axis] = 0.0
    elif drone.mode == DEMAND:
        _follow_demand(drone)


@subroutine
def _follow_demand(drone: Record) -> None:
    """Advance a demand's angles by its rates, and rotate its velocity with the drone."""
    if drone.turn_rate != 0.0:
        ahead = wrap(drone.reference_yaw + drone.turn_rate * CYCLE - drone.believed_yaw)
        ahead = min(max(ahead, -MOST_TURN), MOST_TURN)
        drone.reference_yaw = drone.believed_yaw + ahead
    drone.tilt[0] += drone.tilt_rate[0] * CYCLE
    drone.tilt[1] += drone.tilt_rate[1] * CYCLE
    if drone.in_body:
        cos, sin = math.cos(drone.believed_yaw), math.sin(drone.believed_yaw)
        ahead, aside = drone.heading[0], drone.heading[1]
        drone.reference_velocity[0] = cos * ahead - sin * aside
        drone.reference_velocity[1] = sin * ahead + cos * aside


@subroutine
def _follow_trajectory(drone: Record, passed: float) -> None:
    """Set the reference to the point of the trajectory after a fraction `passed` of its time."""
    u = min(passed, 1.0)
    rate = 1.0 / drone.trajectory_duration
    for axis in range(4):
        value, slope, curve = _polynomial(drone.trajectory[axis], u)
        if axis == 3:  # noqa: PLR2004 -- yaw
            drone.reference_yaw = value
        else:
            drone.reference_position[axis] = value
            drone.reference_velocity[axis] = slope * rate
            drone.reference_acceleration[axis] = curve * rate * rate
    if passed >= 1.0:
        for axis in range(3):
            drone.reference_velocity[axis] = drone.reference_acceleration[axis] = 0.0
        drone.finished = 1
        if drone.landing:
            drone.mode = OFF


def ending_at_rest(
    start: Array, velocity: Array, acceleration: Array, end: Array, duration: Array
) -> Array:
    """Return polynomials of order 7 that come to rest, as the firmware's planner makes them.

    Value, velocity and acceleration match at the start, where the third derivative is 0; at the
    end the first three derivatives are.

    Args:
        start: (K,) value at the start.
        velocity: (K,) per second.
        acceleration: (K,) per second².
        end: (K,) value at the end.
        duration: (K,) s.

    Returns:
        (K, 8) coefficients over the fraction of time passed, constant first.

    Example:
        >>> one = np.ones(1)
        >>> ending_at_rest(0 * one, 0 * one, 0 * one, one, one).round(6) + 0.0
        array([[  0.,   0.,   0.,   0.,  35., -84.,  70., -20.]])
    """
    slope, half = velocity * duration, acceleration * duration**2 / 2
    lacking = np.stack([end - start - slope - half, -slope - 2 * half, -2 * half, 0 * end], axis=1)
    return np.concatenate(
        [np.stack([start, slope, half, 0 * end], axis=1), lacking @ _ENDING.T], axis=1
    )


def can_fly(drones: Drones, rows: Rows) -> Mask:
    """Return the (K,) mask of drones that accept commands, by their (K,) rows."""
    able: Mask = (drones["locked"][rows] == 0) & (drones["crashed"][rows] == 0)
    return able


def obey(drones: Drones, command: Command, now: float) -> None:
    """Start a command at mission time `now`, s, on the drones that can fly.

    Uploaded trajectories are handled by `star_sim.pieces`.
    """
    able = can_fly(drones, command.agent)
    rows = command.agent[able]
    if command.order is Order.STOP:
        drones["mode"][rows] = OFF
        drones["finished"][rows] = 1
    elif command.order is not Order.ARM:
        landing = command.order is Order.LAND
        turning = command.order is Order.GOTO
        target = command.position[able].copy()
        start, velocity, acceleration, yaw = _reference(drones, rows)
        if not turning:  # straight, and from rest: ``plan_takeoff_or_landing`` of ``planner.c``
            target[:, :2] = start[:, :2]
            velocity, acceleration = 0 * velocity, 0 * acceleration
        turn = wrap_angle(command.yaw[able] - yaw)
        end_yaw = yaw + turn if turning else yaw
        duration = command.duration[able]
        for axis in range(3):
            drones["trajectory"][rows, axis] = ending_at_rest(
                start[:, axis], velocity[:, axis], acceleration[:, axis], target[:, axis], duration
            )
        zero = np.zeros(len(rows))
        drones["trajectory"][rows, 3] = ending_at_rest(yaw, zero, zero, end_yaw, duration)
        drones["trajectory_start"][rows] = now
        drones["trajectory_duration"][rows] = duration
        drones["landing"][rows] = landing
        drones["finished"][rows] = 0
        drones["mode"][rows] = TRAJECTORY


@compiled
def take(drones: Drones, velocity: Array, yaw: Array, active: Mask, now: float) -> None:
    """Fly the setpoints of the active rows from mission time `now`, s, on.

    Args:
        drones: (N,) records.
        velocity: (N, 3) m/s.
        yaw: (N,) rad.
        active: (N,) which of these are flown.
        now: s.
    """
    for row in range(len(active)):
        drone = drones[row]
        if not active[row] or drone.locked != 0 or drone.crashed != 0:
            continue
        for axis in range(3):
            drone.reference_velocity[axis] = velocity[row, axis]
            drone.reference_acceleration[axis] = 0.0
        drone.reference_yaw = yaw[row]
        drone.setpoint_time = now
        if drone.mode == TRAJECTORY:
            drone.finished = 1
        drone.mode = VELOCITY


def _reference(drones: Drones, rows: Rows) -> tuple[Array, Array, Array, Array]:
    """Return position, velocity, acceleration and yaw that a trajectory starts from.

    They are the trajectory's if the drone is on one, otherwise the estimate's.
    """
    some = drones[rows]
    planned: Mask = some["mode"] == TRAJECTORY
    moving = (some["mode"] == VELOCITY)[:, None]
    column = planned[:, None]
    return (
        np.where(column, some["reference_position"], some["believed_position"]),
        np.where(column, some["reference_velocity"], some["believed_velocity"] * moving),
        np.where(column, some["reference_acceleration"], 0.0),
        np.where(planned, some["reference_yaw"], some["believed_yaw"]),
    )
