"""One row of the simulator, as the firmware of one vehicle works with it."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from star_core import Array, Corrections
from star_fleet.setpoints import Demand
from star_sim.cascade import CONTROLLERS
from star_sim.drone import DEMAND, OFF
from star_sim.pieces import Piece, enter
from star_sim.transport import Simulator

# ``ControllerType`` of ``controller.h``; the other ones are not simulated.
CONTROLLER_TYPES: Final = {1: CONTROLLERS["pid"], 2: CONTROLLERS["mellinger"]}


class Craft:
    """What flies, and what is known of it on board."""

    def __init__(self, simulator: Simulator, row: int) -> None:
        self._simulator = simulator
        self._row = row
        self._drone = simulator.drones[row]  # a view: what is written here the kernel sees

    @property
    def state(self) -> tuple[Array, Array]:
        """State of the estimator: (4,) x, y, z, m, and yaw, rad; (4,) its rate of change."""
        drone = self._drone
        pose = np.append(drone["believed_position"], drone["believed_yaw"])
        return pose, np.append(drone["believed_velocity"], 0.0)

    @property
    def tumbled(self) -> bool:
        """Whether it lies on its back or side."""
        return bool(self._drone["tumbled"])

    @property
    def crashed(self) -> bool:
        """Whether it has tumbled in flight."""
        return bool(self._drone["crashed"])

    @property
    def controller(self) -> int:
        """Number of the controller that flies it, as in ``stabilizer.controller``."""
        if self._simulator.cascades is None:
            return 1
        kind = self._simulator.cascades["controller"][self._row]
        return next(number for number, name in CONTROLLER_TYPES.items() if name == kind)

    @controller.setter
    def controller(self, number: int) -> None:
        if self._simulator.cascades is not None and number in CONTROLLER_TYPES:
            self._simulator.cascades["controller"][self._row] = CONTROLLER_TYPES[number]

    def stop(self) -> None:
        """Stop the motors."""
        self._drone["mode"] = OFF

    def lock(self) -> None:
        """Stop the motors for good."""
        self.stop()
        self._drone["locked"] = 1

    def restart(self) -> None:
        """Stop the motors and reset the flight, as a reboot does."""
        self.stop()
        self._drone["locked"] = self._drone["crashed"] = self._drone["finished"] = 0
        self._drone["motors_time"] = -math.inf
        self.begin_estimate(0.0, 0.0, 0.0)

    def recover(self) -> None:
        """Reset the crash."""
        self._drone["crashed"] = 0

    def follow(self, piece: Piece, began: float, *, lands: bool) -> None:
        """Follow a piece that began at `began`, s, and stop the motors at its end if it lands."""
        enter(self._drone, piece, began, lands=lands)

    def demand(self, demand: Demand) -> None:
        """Execute a setpoint."""
        drone = self._drone
        if demand.stops:
            drone["mode"] = OFF
            return
        if demand.yaw is not None:
            drone["reference_yaw"] = demand.yaw
        elif drone["mode"] != DEMAND:
            drone["reference_yaw"] = drone["believed_yaw"]
        drone["axes"] = demand.axes
        drone["reference_position"] = demand.position
        drone["reference_velocity"] = demand.velocity
        drone["reference_acceleration"] = demand.acceleration
        drone["in_body"] = demand.in_body
        drone["heading"] = demand.velocity[:2]
        if any(demand.tilt_rate) and drone["mode"] == DEMAND:
            drone["tilt"] = [
                old if rate else new
                for old, new, rate in zip(drone["tilt"], demand.tilt, demand.tilt_rate, strict=True)
            ]
        else:
            drone["tilt"] = demand.tilt
        drone["tilt_rate"] = demand.tilt_rate
        drone["lift"] = demand.lift
        drone["turn_rate"] = demand.turn_rate
        drone["mode"] = DEMAND

    def correct(
        self,
        position: tuple[float, float, float],
        deviation: float,
        attitude: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
        attitude_deviation: float = math.inf,
    ) -> None:
        """Pass a received pose to the estimator, with standard deviations in m and rad."""
        self._simulator.correct(
            Corrections(
                agent=np.array([self._row]),
                position=np.array([position], float),
                attitude=np.array([attitude], float),
                position_deviation=np.array([deviation]),
                attitude_deviation=np.array([attitude_deviation]),
            )
        )

    def receive_positions(self, *, on: bool) -> None:
        """Let the receiver of a positioning system, if it has one, correct the estimator or not."""
        if self._simulator.onboard is not None:
            self._simulator.onboard.receives[self._row] = on

    def begin_estimate_in_map(self) -> None:
        """Start the estimator anew, at its pose in the map, as a positioning system measures it."""
        x, y = self._drone["position"][:2].tolist()
        self.begin_estimate(x, y, float(self._drone["seen_yaw"]))

    def begin_estimate(self, x: float, y: float, yaw: float) -> None:
        """Start the estimator anew: it is at `x` and `y`, m, with heading `yaw`, rad.

        The odometry frame is moved to where that is true. The ranger measures the height at once.
        """
        drone = self._drone
        drone["origin_yaw"] = turn = float(drone["seen_yaw"]) - yaw
        cos, sin = math.cos(turn), math.sin(turn)
        drone["origin"][0] = drone["position"][0] - (cos * x - sin * y)
        drone["origin"][1] = drone["position"][1] - (sin * x + cos * y)
        drone["believed_position"][:2] = x, y
        drone["believed_velocity"] = 0.0
        drone["believed_yaw"] = yaw
        drone["slip"] = cos, -sin
        simulator = self._simulator
        simulator.fusion.forget(simulator.drones, self._row, simulator.time)
        if simulator.onboard is not None:
            simulator.fusion.start_unknown(self._row)
