"""Discharge of a battery in hover, without the simulator's kernels."""

from __future__ import annotations

from typing import Any

import numpy as np

from star_core import Array

CAPACITY = 0.25 * 3600  # A s: 250 mAh
HOVER_TIME = 7 * 60  # s, the published flight time
HOVER_CURRENT = CAPACITY / HOVER_TIME  # A: 2.1, electronics with it
RESISTANCE = 0.12  # ohm, cell and leads; assumed: a sag of 0.25 V in hover
CASCADE_RESISTANCE = 0.268  # ohm, of the identified drone, as `star_sim.powertrain`
# V at 0, 10, ... 100 % of charge without load: the table of the firmware's pm_stm32f4.c, and full.
VOLTAGE_OF_CHARGE = (3.00, 3.78, 3.83, 3.87, 3.89, 3.92, 3.96, 4.00, 4.04, 4.10, 4.20)
CHARGE = np.linspace(0.0, 1.0, len(VOLTAGE_OF_CHARGE))  # of full


def hover_voltage(
    flown: Array, *, battery: float, endurance: float, controller: str, **_others: Any
) -> Array:
    """Return the voltages of batteries in hover, (N,) V, after times in the air, (N,) s.

    Args:
        flown: Times in the air.
        battery: Charge at the start, as a fraction of full.
        endurance: Hover time with a full battery, s.
        controller: Of the drones, which determines whose battery they have.
    """
    charge = np.clip(battery - flown / endurance, 0.0, 1.0)
    resistance = RESISTANCE if controller == "ideal" else CASCADE_RESISTANCE
    voltage: Array = np.interp(charge, CHARGE, VOLTAGE_OF_CHARGE) - resistance * HOVER_CURRENT
    return voltage
