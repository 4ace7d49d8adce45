"""The on-board supervisor: flight states, and when the motors must stop."""

from __future__ import annotations

from star_core import Supervisor
from star_core.toolkit import subroutine
from star_sim.airframe import CYCLE
from star_sim.drone import OFF, TRAJECTORY, Record

FLYING_FOR = 2.0  # s after the motors were last on, as the firmware's is-flying hysteresis
TILTED = 0.5  # share of gravity along the body's z axis: 60°
TILTED_FOR = 1.0  # s
INVERTED = -0.2
INVERTED_FOR = 0.1  # s

_CAN_ARM, _ARMED, _AUTO_ARM, _CAN_FLY, _FLYING, _TUMBLED, _LOCKED, _CRASHED, _ACTIVE, _FINISHED = (
    int(bit)
    for bit in (
        Supervisor.CAN_ARM,
        Supervisor.ARMED,
        Supervisor.AUTO_ARM,
        Supervisor.CAN_FLY,
        Supervisor.FLYING,
        Supervisor.TUMBLED,
        Supervisor.LOCKED,
        Supervisor.CRASHED,
        Supervisor.COMMANDER_ACTIVE,
        Supervisor.COMMANDER_FINISHED,
    )
)


@subroutine
def supervise(drone: Record, now: float) -> None:
    """Record when the motors are on, and stop them if the drone has tumbled.

    Tumbled is 1 s beyond 60° of tilt, or 0.1 s upside down (firmware, ``supervisor.c``; it measures
    the acceleration along the body's z axis, which is taken to be gravity's here). A drone that
    tumbles with its motors on has crashed and stays so.
    """
    upright = 1 - 2 * (drone.attitude[0] ** 2 + drone.attitude[1] ** 2)
    drone.tilted_for = drone.tilted_for + CYCLE if upright < TILTED else 0.0
    drone.inverted_for = drone.inverted_for + CYCLE if upright < INVERTED else 0.0
    drone.tumbled = int(drone.tilted_for > TILTED_FOR or drone.inverted_for > INVERTED_FOR)
    if drone.mode != OFF:
        drone.motors_time = now
        if drone.tumbled:
            drone.mode = OFF
            drone.crashed = 1


@subroutine
def bits(drone: Record, now: float) -> int:
    """Return one drone's bits of `Supervisor` at mission time `now`, s."""
    state = _AUTO_ARM
    if drone.locked == 0 and drone.crashed == 0:
        state |= _CAN_ARM | _ARMED
        if drone.tumbled == 0:
            state |= _CAN_FLY
    if now - drone.motors_time < FLYING_FOR:
        state |= _FLYING
    if drone.tumbled:
        state |= _TUMBLED
    if drone.locked:
        state |= _LOCKED
    if drone.crashed:
        state |= _CRASHED
    if drone.mode == TRAJECTORY:
        state |= _ACTIVE
    if drone.finished:
        state |= _FINISHED
    return state
