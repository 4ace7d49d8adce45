"""Faults of motors, batteries and sensors of the simulated drones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from star_core import PluginError
from star_core.toolkit import Fault
from star_sim.drone import Drones

RANDOM_FLOW: Final = 1.0  # m/s, standard deviation of a flow sensor's garbage
RANDOM_RATE: Final = 1.0  # rad/s, of a gyro's
RANDOM_HEIGHT: Final = 0.5  # m, of a ranger's

_ESTIMATED: Final = {"flow", "gyro", "ranger"}
_ERRORS: Final = ("scale", "misalignment", "velocity_bias", "gyro_bias", "ranger_bias")
_SHARES: Final = ("motor_share", "flow_share", "ranger_share")
_STREAM: Final = 7338


class DroneFaults:
    """Sets the errors and shares in the state of the drones as faults come and go.

    Args:
        drones: (N,) records of `DRONE`, changed in place; their own errors are drawn.
        faults: Of motors, batteries, flow sensors, gyros and rangers.
        seed: Of the flight.
        noise: Whether the drones estimate their state.

    Raises:
        PluginError: Without noise, estimates equal the ground truth: sensors have no faults. Or it
            is one of a Flow deck, without any.
    """

    def __init__(self, drones: Drones, faults: Sequence[Fault], seed: int, *, noise: bool) -> None:
        sensors = sorted(_ESTIMATED & {fault.component for fault in faults})
        if sensors and not noise:
            raise PluginError(f"simulates no faults of {', '.join(sensors)} with `noise: false`")
        lacking = [name for name in ("flow", "ranger") if name in sensors]
        if lacking and not drones["flow_share"].any():
            raise PluginError(f"simulates no faults of {', '.join(lacking)} without Flow decks")
        self._drones = drones
        self._faults = faults
        self._nominal = {name: drones[name].copy() for name in (*_ERRORS, *_SHARES)}
        self._randoms = [np.random.default_rng([seed, _STREAM, fault.number]) for fault in faults]

    def apply(self, time: float) -> None:
        """Set the state of the drones as the faults at a mission time, s, demand."""
        drones = self._drones
        for name, nominal in self._nominal.items():
            drones[name] = nominal
        for fault, random in zip(self._faults, self._randoms, strict=True):
            if rows := list(fault.rows(time)):
                self._apply(fault, rows, random)

    def _apply(self, fault: Fault, rows: list[int], random: np.random.Generator) -> None:
        drones, values, mode = self._drones, fault.values, fault.mode
        match fault.component:
            case "motor":
                works = {"wrong": values["factor"], "off": 0.0}.get(mode)
                if works is None:  # intermittent
                    works = float(random.random() >= values["loss"])
                for motor in values["motors"]:
                    drones["motor_share"][rows, motor - 1] = works
            case "battery":
                charge = np.minimum(drones["charge"][rows], values["charge"])
                drones["charge"][rows] = charge
            case "flow" if mode != "off":
                self._mislead_flow(fault, rows, random)
            case sensor if mode == "off":
                drones[f"{sensor}_share"][rows] = 0.0
            case sensor:
                spread = RANDOM_RATE if sensor == "gyro" else RANDOM_HEIGHT
                noise = spread * random.standard_normal(len(rows))
                drones[f"{sensor}_bias"][rows] += values["bias"] if mode == "wrong" else noise

    def _mislead_flow(self, fault: Fault, rows: list[int], random: np.random.Generator) -> None:
        drones = self._drones
        if fault.mode == "stuck":  # it sees no motion
            drones["misalignment"][rows] = drones["velocity_bias"][rows] = 0.0
        elif fault.mode == "wrong":
            drones["scale"][rows] = (1 + drones["scale"][rows]) * fault.values["factor"] - 1
        else:
            drones["velocity_bias"][rows] += RANDOM_FLOW * random.standard_normal((len(rows), 2))
