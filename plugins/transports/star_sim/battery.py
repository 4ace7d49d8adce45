"""Battery model: discharge by thrust, and voltage sag under load."""

from __future__ import annotations

import math

from star_core.toolkit import subroutine
from star_sim.airframe import CYCLE, HOVER_THRUST, THRUST_MAX, THRUST_OF_VOLTAGE
from star_sim.discharge import HOVER_CURRENT, VOLTAGE_OF_CHARGE
from star_sim.drone import Record

ELECTRONICS_CURRENT = 0.1  # A, assumed
CURRENT_PER_POWER = (HOVER_CURRENT - ELECTRONICS_CURRENT) / (4 * HOVER_THRUST**1.5)  # A / N^1.5


@subroutine
def open_voltage(charge: float) -> float:
    """Return the voltage without load at a fraction of charge, V."""
    position = min(max(charge, 0.0), 1.0) * 10
    below = min(int(position), 9)
    low, high = VOLTAGE_OF_CHARGE[below], VOLTAGE_OF_CHARGE[below + 1]
    return low + (position - below) * (high - low)


@subroutine
def thrust_at(voltage: float) -> float:
    """Return the maximum thrust of one motor at a voltage, N (``platform_defaults_cf2.h``)."""
    a, b, c, d = THRUST_OF_VOLTAGE
    return min(max(a + voltage * (b + voltage * (c + voltage * d)), 0.0), THRUST_MAX)


@subroutine
def drain(drone: Record, resistance: float) -> None:
    """Discharge one drone's battery by one cycle, and set its voltage and motor limit.

    The power of a propeller goes with its thrust to the power of 1.5 (momentum theory), and its
    current with its power. An empty battery gives no thrust at all.

    Args:
        drone: The drone.
        resistance: Of cell and leads, ohm.
    """
    power = 0.0
    for motor in range(4):
        power += drone.thrust[motor] * math.sqrt(drone.thrust[motor])
    current = ELECTRONICS_CURRENT + CURRENT_PER_POWER * power
    drone.charge = max(0.0, drone.charge - current * CYCLE / drone.capacity)
    drone.voltage = open_voltage(drone.charge) - resistance * current
    drone.thrust_limit = thrust_at(drone.voltage) if drone.charge > 0 else 0.0
