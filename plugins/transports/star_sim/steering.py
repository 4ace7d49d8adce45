"""Setpoints of the drones: velocities, or full states of a trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from star_core import Array, Setpoint
from star_core.toolkit import FullStates, VelocityLead, some
from star_sim import position
from star_sim.cascade import MAX_LEAD
from star_sim.commander import LEVEL_AFTER, take
from star_sim.drone import DEMAND, POSITION, VELOCITY, Drones

if TYPE_CHECKING:
    from star_core import Mask


class Steering:
    """Flies setpoints as the drones' controller can: trajectories too.

    With Mellinger's law a trajectory is flown by full states. They begin where the velocity
    setpoints before them have led the drone's moving position, and such setpoints continue from
    them. With the other controllers its velocities make up for the lag.

    Args:
        drones: (N,) records.
        leads: (N, 3) of velocity setpoints with Mellinger's law, m: see
            `star_sim.cascade.regulate`; None with another controller.
        period: Of the ticks, s.
        ideal: Whether the controller is ``ideal``.
    """

    def __init__(self, drones: Drones, leads: Array | None, period: float, *, ideal: bool) -> None:
        n = len(drones)
        self._drones, self._leads = drones, leads
        self._states = FullStates(n, period)
        self._lead = VelocityLead(n, period)
        if ideal:
            gain, integral = position.VELOCITY_GAIN, position.INTEGRAL_GAIN
            self._lead = VelocityLead(n, period, gain=gain, integral=integral, delay=0.0)

    def velocity(self, setpoint: Setpoint) -> Array:
        """Return the (N, 3) velocities to fly in rows without a full state, m/s."""
        return self._lead.velocity(setpoint) if self._leads is None else setpoint.velocity

    def take(self, setpoint: Setpoint, velocity: Array, active: Mask, now: float) -> None:
        """Fly the active rows, (N,), of a setpoint from mission time `now`, s, on.

        Args:
            setpoint: Sent by `velocity`.
            velocity: What that returned.
            active: (N,) rows that have been received.
            now: s.
        """
        drones = self._drones
        take(drones, velocity, setpoint.yaw, active, now)
        if self._leads is None or not some(self._states.rows | setpoint.followed()):
            return
        rows = setpoint.followed() & active & (drones["mode"] == VELOCITY)
        over = self._states.rows & ~rows
        lead = self._states.position[over] - drones["believed_position"][over]
        self._leads[over] = np.clip(lead, -MAX_LEAD, MAX_LEAD)
        begin = drones["believed_position"] + self._leads
        position, velocity, acceleration = self._states.advance(setpoint, rows, begin)
        drones["mode"][rows] = DEMAND
        drones["axes"][rows] = POSITION
        drones["in_body"][rows] = drones["turn_rate"][rows] = 0
        drones["reference_position"][rows] = position[rows]
        drones["reference_velocity"][rows] = velocity[rows]
        drones["reference_acceleration"][rows] = acceleration[rows]

    def level(self, now: float) -> None:
        """Level drones whose last state is older than `LEVEL_AFTER` at mission time `now`, s."""
        if some(self._states.rows):
            stale = self._states.rows & (now - self._drones["setpoint_time"] > LEVEL_AFTER)
            self._drones["mode"][stale & (self._drones["mode"] == DEMAND)] = VELOCITY
