"""State reports of all drones at a tick, in one kernel call."""

from __future__ import annotations

import math

from star_sim.compiled import Record, kernel
from star_sim.supervisor import bits


@kernel
def report(drones: Record, now: float, attitude: Record, state: Record) -> None:
    """Write each drone's estimated attitude and the bits of its state.

    Args:
        drones: (N,) records.
        now: Mission time, s.
        attitude: (N, 4) unit quaternions x, y, z, w from the body to the odometry frame: turns by
            roll about x, then by pitch about y, then by yaw about z.
        state: (N,) bits of `Supervisor`.
    """
    for i in range(len(drones)):
        drone = drones[i]
        cr, sr = math.cos(drone.believed_roll / 2), math.sin(drone.believed_roll / 2)
        cp, sp = math.cos(drone.believed_pitch / 2), math.sin(drone.believed_pitch / 2)
        cy, sy = math.cos(drone.believed_yaw / 2), math.sin(drone.believed_yaw / 2)
        attitude[i, 0] = sr * cp * cy - cr * sp * sy
        attitude[i, 1] = cr * sp * cy + sr * cp * sy
        attitude[i, 2] = cr * cp * sy - sr * sp * cy
        attitude[i, 3] = cr * cp * cy + sr * sp * sy
        state[i] = bits(drone, now)
