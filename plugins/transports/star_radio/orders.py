"""CRTP packets for flight: setpoints, high-level commands, arming and pose corrections.

Angles are in rad here, in degrees only inside packets that use degrees; every function states its
frame. Formats follow the firmware's ``crtp_commander_generic.c``,
``crtp_commander_high_level.c`` and ``crtp_localization_service.c``.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Final

from star_radio.packets import FARTHEST, packet

PLATFORM, LOCALISATION, SETPOINT, HIGH_LEVEL, SUPERVISOR = 13, 6, 7, 8, 9
GOTO_LINEAR_FROM = 8  # first protocol version with GO_TO_2
YAW_RATE_FROM = 9  # first protocol version with anticlockwise yaw rates
START_YAW_FROM = 10  # first protocol version with START_TRAJECTORY_2
SUPERVISOR_FROM = 12  # first protocol version with a port for the supervisor
STOP, LAND = 3, 8  # commands to the high-level commander
ALL_GROUPS: Final = 0  # mask that addresses all drones, whatever their groups
MISSION: Final = 1  # bit of the group of all drones of the mission
_GROUPS: Final = 2  # offset of the mask, after the header and the command number
KEEP_YAW: Final = 1
_ROOT_HALF = math.sqrt(0.5)
_MAGNITUDE = 511  # nine bits


def velocity(velocity: Sequence[float], yaw_rate: float, version: int) -> bytes:
    """Velocity setpoint, m/s in the odometry frame, with `yaw_rate`, rad/s anticlockwise."""
    rate = math.degrees(yaw_rate)
    kind, rate = (8, rate) if version >= YAW_RATE_FROM else (1, -rate)
    return packet(SETPOINT, 0, struct.pack("<Bffff", kind, *velocity, rate))


def position(position: Sequence[float], yaw: float) -> bytes:
    """Position setpoint, m in the odometry frame, with heading `yaw`, rad; flown directly."""
    return packet(SETPOINT, 0, struct.pack("<Bffff", 7, *position, math.degrees(yaw)))


def full_state(
    position: Sequence[float],
    velocity: Sequence[float],
    acceleration: Sequence[float],
    attitude: Sequence[float],
    rates: Sequence[float],
) -> bytes:
    """Full-state setpoint, in the odometry frame.

    Args:
        position: m.
        velocity: m/s.
        acceleration: m/s².
        attitude: Unit quaternion x, y, z, w from the body to the odometry frame.
        rates: About the body axes, rad/s; sent in mrad/s.

    Raises:
        ValueError: A number is outside ±`FARTHEST`.
    """
    thousandths = [
        round(1000 * value)
        for value in (
            *position,
            *velocity,
            *acceleration,
            0,
            *rates,
        )  # 0: attitude, below
    ]
    if any(abs(value) > 1000 * FARTHEST for value in thousandths):
        got = [value / 1000 for value in thousandths]
        raise ValueError(f"expected a state within ±{FARTHEST}, got {got!r}")
    thousandths[9] = packed_quaternion(attitude)
    return packet(SETPOINT, 0, struct.pack("<BhhhhhhhhhIhhh", 6, *thousandths))


def no_more_setpoints() -> bytes:
    """Let the high-level commander take over; its commands are not flown before that."""
    return packet(SETPOINT, 1, struct.pack("<BI", 0, 0))


def takeoff(height: float, duration: float) -> bytes:
    """Climb straight up to z = `height`, m in the odometry frame, within `duration`, s."""
    return packet(
        HIGH_LEVEL, 0, struct.pack("<BBffBf", 7, ALL_GROUPS, height, 0.0, KEEP_YAW, duration)
    )


def land(height: float, duration: float) -> bytes:
    """Descend straight down to z = `height`, m in the odometry frame, within `duration`, s."""
    return packet(
        HIGH_LEVEL, 0, struct.pack("<BBffBf", LAND, ALL_GROUPS, height, 0.0, KEEP_YAW, duration)
    )


def go_to(position: Sequence[float], yaw: float, duration: float, version: int) -> bytes:
    """Fly to a position, m, and heading `yaw`, rad, in the odometry frame, within `duration`, s."""
    where = struct.pack("<fffff", *position, yaw, duration)
    if version >= GOTO_LINEAR_FROM:
        return packet(HIGH_LEVEL, 0, bytes([12, ALL_GROUPS, 0, 0]) + where)
    return packet(HIGH_LEVEL, 0, bytes([4, ALL_GROUPS, 0]) + where)


def stop() -> bytes:
    """Stop the motors."""
    return packet(HIGH_LEVEL, 0, bytes([STOP, ALL_GROUPS]))


def set_groups(groups: int) -> bytes:
    """Assign the drone to some of the eight groups, one bit each, until it is switched off."""
    return packet(HIGH_LEVEL, 0, bytes([0, groups]))


def only_for(groups: int, order: bytes) -> bytes:
    """Return a command restricted to the drones in any of some groups, a bit each.

    Args:
        groups: 1 to 255; 0 addresses all drones.
        order: Command to take off, land, go to, stop, or start a trajectory.

    >>> only_for(0b101, stop()).hex()
    '8c0305'
    """
    return order[:_GROUPS] + bytes([groups]) + order[_GROUPS + 1 :]


def define_trajectory(number: int, pieces: int, at: int = 0, *, compressed: bool = False) -> bytes:
    """Assign a number to the pieces written to the trajectory memory from byte `at` on."""
    return packet(HIGH_LEVEL, 0, struct.pack("<BBBBIB", 6, number, 1, compressed, at, pieces))


def start_trajectory(
    number: int, version: int, *, stretch: float = 1.0, relative: bool = False
) -> bytes:
    """Fly a trajectory `stretch` times slower than defined; if `relative`, from here."""
    if version >= START_YAW_FROM:
        head = struct.pack("<BBBBBB", 13, ALL_GROUPS, relative, 0, 0, number)
    else:
        head = struct.pack("<BBBBB", 5, ALL_GROUPS, relative, 0, number)
    return packet(HIGH_LEVEL, 0, head + struct.pack("<f", stretch))


def arm(version: int) -> bytes:
    """Arm the motors."""
    if version >= SUPERVISOR_FROM:
        return packet(SUPERVISOR, 1, bytes([1, 1]))
    return packet(PLATFORM, 0, bytes([1, 1]))


def emergency_stop(version: int) -> bytes:
    """Stop the motors and lock the drone until a power cycle."""
    if version >= SUPERVISOR_FROM:
        return packet(SUPERVISOR, 1, bytes([3]))
    return packet(LOCALISATION, 1, bytes([3]))


def keep_alive(version: int) -> bytes:
    """Reset the emergency-stop watchdog; the first reset starts it, and it expires after 1 s."""
    if version >= SUPERVISOR_FROM:
        return packet(SUPERVISOR, 1, bytes([4]))
    return packet(LOCALISATION, 1, bytes([4]))


def seen_at(position: Sequence[float]) -> bytes:
    """Measured position for the estimator, m in the odometry frame."""
    return packet(LOCALISATION, 0, struct.pack("<fff", *position))


def seen_as(position: Sequence[float], attitude: Sequence[float]) -> bytes:
    """Measured pose for the estimator: m and unit quaternion x, y, z, w, in the odometry frame."""
    return packet(LOCALISATION, 1, struct.pack("<Bfffffff", 8, *position, *attitude))


def packed_quaternion(quaternion: Sequence[float]) -> int:
    """Return a unit quaternion x, y, z, w in 32 bits: its three smallest components, to 1/723.

    The largest component is omitted, with the signs chosen so that it is positive (firmware,
    ``quatcompress.h``).

    >>> hex(packed_quaternion([0, 0, 0, 1]))
    '0xc0000000'
    """
    norm = math.sqrt(sum(value * value for value in quaternion))
    largest = max(range(4), key=lambda i: abs(quaternion[i]))
    turned = quaternion[largest] < 0
    packed = largest
    for i, value in enumerate(quaternion):
        if i != largest:
            negative = (value < 0) != turned
            magnitude = int(_MAGNITUDE * (abs(value) / norm / _ROOT_HALF) + 0.5)
            packed = packed << 10 | negative << 9 | magnitude
    return packed
