"""Packets for flight: setpoints, high-level commands, arming and pose corrections.

cflib's own commanders pack them: `_packed` gives a commander an object that keeps the packet
instead of sending it. Angles are in rad here, in degrees only inside packets that use degrees;
every function states its frame.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

from cflib.crazyflie.commander import Commander
from cflib.crazyflie.high_level_commander import HighLevelCommander
from cflib.crazyflie.localization import Localization
from cflib.crazyflie.supervisor import Supervisor
from cflib.crtp.crtpstack import CRTPPacket
from cflib.utils.encoding import compress_quaternion

from star_radio.connection.packets import LOCALISATION, packet

SUPERVISOR_FROM = 12  # first protocol version with a port for the supervisor
LATEST: Final = 12  # protocol version
STOP, LAND = 3, 8  # commands to the high-level commander
ALL_GROUPS: Final = 0  # mask that addresses all drones, whatever their groups
MISSION: Final = 1  # bit of the group of all drones of the mission
_GROUPS: Final = 2  # offset of the mask, after the header and the command number


class _Recorder:
    """Keeps the packet that a commander sends; to the commander it is cflib's `Crazyflie`."""

    def __init__(self, version: int) -> None:
        self.packet = b""
        self.platform = self
        self._version = version

    def get_protocol_version(self) -> int:
        return self._version

    def add_port_callback(self, *_what: object) -> None:
        """Ignore that the commander also wants to receive."""

    def send_packet(self, packet: CRTPPacket, **_how: object) -> None:
        self.packet = bytes([packet.get_header()]) + bytes(packet.data)


def _packed(commander: Any, method: str, *values: Any, version: int = LATEST, **how: Any) -> bytes:
    """Return the packet that a method of one of cflib's commanders sends."""
    recorder = _Recorder(version)
    getattr(commander(recorder), method)(*values, **how)
    return recorder.packet


def velocity(velocity: Sequence[float], yaw_rate: float, version: int) -> bytes:
    """Velocity setpoint, m/s in the odometry frame, with `yaw_rate`, rad/s anticlockwise."""
    values = (*velocity, math.degrees(yaw_rate))
    return _packed(Commander, "send_velocity_world_setpoint", *values, version=version)


def full_state(
    position: Sequence[float],
    velocity: Sequence[float],
    acceleration: Sequence[float],
    attitude: Sequence[float],
    rates: Sequence[float],
) -> bytes:
    """Full-state setpoint in the odometry frame; sent in thousandths.

    Args:
        position: m, within ±32.767.
        velocity: m/s.
        acceleration: m/s².
        attitude: Quaternion x, y, z, w from the body to the odometry frame.
        rates: About the body axes, rad/s: cflib documents degrees, but the firmware reads mrad/s.
    """
    vectors = _rounded(position), _rounded(velocity), _rounded(acceleration)
    return _packed(Commander, "send_full_state_setpoint", *vectors, attitude, *_rounded(rates))


def _rounded(values: Sequence[float]) -> list[float]:
    """Return values whose thousandths, which cflib truncates, are the nearest ones."""
    return [(round(1000 * value) + math.copysign(0.1, value)) / 1000 for value in values]


def no_more_setpoints() -> bytes:
    """Let the high-level commander take over; its commands are not flown before that."""
    return _packed(Commander, "send_notify_setpoint_stop")


def takeoff(height: float, duration: float) -> bytes:
    """Climb straight up to z = `height`, m in the odometry frame, within `duration`, s."""
    return _packed(HighLevelCommander, "takeoff", height, duration, yaw=None)


def land(height: float, duration: float) -> bytes:
    """Descend straight down to z = `height`, m in the odometry frame, within `duration`, s."""
    return _packed(HighLevelCommander, "land", height, duration, yaw=None)


def go_to(position: Sequence[float], yaw: float, duration: float, version: int) -> bytes:
    """Fly to a position, m, and heading `yaw`, rad, in the odometry frame, within `duration`, s."""
    return _packed(HighLevelCommander, "go_to", *position, yaw, duration, version=version)


def stop() -> bytes:
    """Stop the motors."""
    return _packed(HighLevelCommander, "stop")


def set_groups(groups: int) -> bytes:
    """Assign the drone to some of the eight groups, one bit each, until it is switched off."""
    return _packed(HighLevelCommander, "set_group_mask", groups)


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
    values = (number, at, pieces, int(compressed))
    return _packed(HighLevelCommander, "define_trajectory", *values)


def start_trajectory(
    number: int, version: int, *, stretch: float = 1.0, relative: bool = False
) -> bytes:
    """Fly a trajectory `stretch` times slower than defined; if `relative`, from here."""
    values = (number, stretch, relative)
    return _packed(HighLevelCommander, "start_trajectory", *values, version=version)


def arm(version: int) -> bytes:
    """Arm the motors."""
    return _packed(Supervisor, "send_arming_request", True, version=version)  # noqa: FBT003


def emergency_stop(version: int) -> bytes:
    """Stop the motors and lock the drone until a power cycle."""
    return _packed(Supervisor, "send_emergency_stop", version=version)


def keep_alive(version: int) -> bytes:
    """Reset the emergency-stop watchdog; the first reset starts it, and it expires after 1 s."""
    return _packed(Supervisor, "send_emergency_stop_watchdog", version=version)


def measured_position(position: Sequence[float]) -> bytes:
    """Measured position for the estimator, m in the odometry frame."""
    return _packed(Localization, "send_extpos", position)


def measured_pose(position: Sequence[float], attitude: Sequence[float]) -> bytes:
    """Measured pose for the estimator: m and unit quaternion x, y, z, w, in the odometry frame."""
    return _packed(Localization, "send_extpose", position, attitude)


class PackedPoses(NamedTuple):
    """Type of a packet with poses of several drones; cflib has none for more than one.

    Attributes:
        channel: Channel of the port LOCALISATION.
        head: First bytes of the payload.
        most: Maximum number of drones in a packet.
    """

    channel: int
    head: bytes
    most: int

    def packet(self, entries: Iterable[bytes]) -> bytes:
        """Return the packet of up to `most` entries, all of this kind."""
        return packet(LOCALISATION, self.channel, self.head + b"".join(entries))


POSITIONS: Final = PackedPoses(2, b"", 4)
POSES: Final = PackedPoses(1, b"\x09", 2)


def pose_entry(
    last: int, position: Sequence[float], attitude: Sequence[float] | None = None
) -> bytes:
    """Return the entry with one drone's position or, given an attitude, its pose.

    Args:
        last: Last byte of the drone's address.
        position: m, within ±32.767; sent in mm.
        attitude: Unit quaternion x, y, z, w.
    """
    entry = struct.pack("<Bhhh", last, *(round(1000 * value) for value in position))
    return entry if attitude is None else entry + struct.pack("<I", compress_quaternion(attitude))
