"""The swarm as scripts see it: the classes of ``crazyflie_py`` and ``pycrazyswarm``."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from star_core import Array, StarError
from star_script.motions import State
from star_script.script_flight import ScriptFlight
from star_script.uav_trajectory import Trajectory, coefficients

LOW_BATTERY: Final = 3.2  # V, at which the firmware's power management reports low power
SOLID_COLOR: Final = 7  # effect of the ring of LEDs
ON_BATTERY, LOW_POWER = 0, 3  # states of the firmware's power management


class _Point(NamedTuple):
    """A position, m, as in ROS."""

    x: float
    y: float
    z: float


class _Quaternion(NamedTuple):
    """An attitude, as in ROS."""

    x: float
    y: float
    z: float
    w: float


class _Pose(NamedTuple):
    """A pose, as in ROS."""

    position: _Point
    orientation: _Quaternion


class _Commands:
    """What one drone and all of them understand."""

    _flight: ScriptFlight

    def takeoff(self, targetHeight: float, duration: float, groupMask: int = 0) -> None:
        """Climb to a height, m, in some time, s."""
        self._flight.take_off(self._heeds(groupMask), float(targetHeight), float(duration))

    def land(self, targetHeight: float, duration: float, groupMask: int = 0) -> None:
        """Descend to the floor in some time, s; the height is that of a drone on it."""
        self._flight.land(self._heeds(groupMask), float(duration))

    def stop(self, groupMask: int = 0) -> None:
        """Stop the motors."""
        self._flight.stop_motors(self._heeds(groupMask))

    def notifySetpointsStop(self, remainValidMillisecs: int = 100, groupMask: int = 0) -> None:
        """Let commands follow setpoints."""
        del remainValidMillisecs
        self._flight.stop_setpoints(self._heeds(groupMask))

    def _heeds(self, mask: int) -> list[int]:
        """Return the rows of the drones that are in some of the groups."""
        return self._flight.rows(int(mask))


class Crazyflie(_Commands):
    """One drone."""

    def __init__(self, flight: ScriptFlight, row: int) -> None:
        agent = flight.scene.agents[row]
        self._flight, self._row, self._agent = flight, row, agent
        self._trajectories: dict[int, list[tuple[float, Array]]] = {}
        self._parameters: dict[str, Any] = {}
        self.prefix = f"/{agent.name}"
        self.name = agent.name
        self.uri = agent.uri or ""
        self.id = _number(agent.name, row)
        self.initialPosition: Array = np.array(agent.start, np.float64)
        self.paramTypeDict: dict[str, Any] = {}

    @property
    def position(self) -> Any:
        """Its position, m: a list."""
        return self.get_position()

    def get_position(self) -> list[float]:
        """Return its position, m."""
        self._flight.poll()
        return [float(value) for value in self._flight.tick.estimate.position[self._row]]

    @property
    def pose(self) -> dict[str, Any]:
        """Its position, m, and its heading as a quaternion."""
        return self.get_pose()

    def get_pose(self) -> dict[str, Any]:
        """Return its position, m, and its heading as a quaternion."""
        return self.poseStamped["pose"]._asdict()  # type: ignore[no-any-return]

    @property
    def poseStamped(self) -> dict[str, Any]:
        """Its pose, a message of ROS, with the time."""
        half = float(self._flight.tick.estimate.yaw[self._row]) / 2
        turn = _Quaternion(0.0, 0.0, math.sin(half), math.cos(half))
        return {**self._stamp(), "pose": _Pose(_Point(*self.get_position()), turn)}

    @property
    def status(self) -> dict[str, Any]:
        """What it reports."""
        return self.get_status()

    def _stamp(self) -> dict[str, Any]:
        """Return its name and the time, as in a header of ROS."""
        time = self._flight.tick.time
        seconds = int(time)
        return {
            "id": self.name,
            "timestamp_sec": seconds,
            "timestamp_nsec": round((time - seconds) * 1e9),
        }

    def get_status(self) -> dict[str, Any]:
        """Return what it reports: battery, supervisor and so on."""
        tick, row = self._flight.tick, self._row
        battery = float(tick.health.battery[row])
        return {
            **self._stamp(),
            "supervisor": int(tick.telemetry.state[row]),
            "battery": battery,
            "pm_state": LOW_POWER if battery < LOW_BATTERY else ON_BATTERY,
            "rssi": 0,
            "num_rx_broadcast": 0,
            "num_tx_broadcast": 0,
            "num_rx_unicast": 0,
            "num_tx_unicast": 0,
        }

    def setGroupMask(self, groupMask: int) -> None:
        """Put it into groups, a bit each."""
        self._flight.masks[self._row] = int(groupMask)

    def goTo(
        self,
        goal: Sequence[float],
        yaw: float,
        duration: float,
        relative: bool = False,
        groupMask: int = 0,
    ) -> None:
        """Fly to a position, m, with a heading, rad, in some time, s; or by an offset."""
        rows = self._heeds(groupMask)
        self._flight.go_to(rows, goal, float(yaw), float(duration), relative=bool(relative))

    def uploadTrajectory(self, trajectoryId: int, pieceOffset: int, trajectory: Trajectory) -> None:
        """Store a trajectory; the offset in the firmware's memory has no meaning."""
        del pieceOffset
        pieces = [(float(p.duration), coefficients(p)) for p in trajectory.polynomials]
        if not pieces:
            raise ValueError("the trajectory has no pieces")
        self._trajectories[int(trajectoryId)] = pieces

    def startTrajectory(
        self,
        trajectoryId: int,
        timescale: float = 1.0,
        reverse: bool = False,
        relative: bool = True,
        groupMask: int = 0,
    ) -> None:
        """Fly a stored trajectory."""
        if not self._heeds(groupMask):
            return
        if (pieces := self._trajectories.get(int(trajectoryId))) is None:
            raise KeyError(f"{self.name} has no trajectory {trajectoryId}; upload it before")
        self._flight.start_trajectory(
            self._row, pieces, timescale=float(timescale), reverse=bool(reverse),
            relative=bool(relative),
        )  # fmt: skip

    def cmdFullState(
        self, pos: Sequence[float], vel: Sequence[float], acc: Sequence[float], yaw: float,
        omega: Sequence[float],
    ) -> None:  # fmt: skip
        """Send a setpoint of a full state."""
        position, velocity, acceleration = (
            np.array(vector, np.float64).reshape(3) for vector in (pos, vel, acc)
        )
        rate = float(np.asarray(omega).reshape(3)[2])
        state = State(position, velocity, acceleration, float(yaw), rate)
        self._flight.stream(self._row, state, "cmdFullState")

    def cmdPosition(self, pos: Sequence[float], yaw: float = 0.0) -> None:
        """Send a setpoint of a position, m, and a heading, rad."""
        position = np.array(pos, np.float64).reshape(3)
        state = State(position, np.zeros(3), np.full(3, np.nan), float(yaw), 0.0)
        self._flight.stream(self._row, state, "cmdPosition")

    def cmdVelocityWorld(self, vel: Sequence[float], yawRate: float) -> None:
        """Send a setpoint of a velocity in the map, m/s, and a yaw rate, rad/s."""
        self._flight.steer(self._row, vel, float(yawRate))

    def cmdHover(self, vx: float, vy: float, yaw_rate: float, z_distance: float) -> None:
        """Send a setpoint of a velocity ahead and aside, m/s, a yaw rate, rad/s, and a height."""
        velocity = (float(vx), float(vy), 0.0)
        self._flight.steer(self._row, velocity, float(yaw_rate), height=float(z_distance))

    def cmdStop(self) -> None:
        """Stop its motors."""
        self._flight.stop_motors([self._row])

    def emergency(self) -> None:
        """Stop its motors."""
        self._flight.stop_motors([self._row])

    def arm(self, arm: bool = True) -> None:
        """Arm it; to disarm it is recorded only."""
        self._flight.arm(self._row, arm=bool(arm))

    def setParam(self, name: str, value: Any) -> None:
        """Set a parameter of its firmware: recorded, and sent by radio."""
        self._set({name: value}, "setParam", f"{name} {value}")

    def getParam(self, name: str) -> Any:
        """Return a parameter as it was set, or 0."""
        return self._parameters.get(str(name).replace("/", "."), 0)

    def setParams(self, params: dict[str, Any]) -> None:
        """Set some parameters."""
        for name, value in params.items():
            self.setParam(name, value)

    def setLEDColor(self, r: float, g: float, b: float) -> None:
        """Set the color of its ring of LEDs; components are from 0 to 1."""
        solid = {
            f"ring.solid{name}": round(255 * min(1.0, max(0.0, float(component))))
            for name, component in zip(("Red", "Green", "Blue"), (r, g, b), strict=True)
        }
        self._set({"ring.effect": SOLID_COLOR, **solid}, "setLEDColor", f"{r} {g} {b}")

    def enableCollisionAvoidance(self, others: Any, ellipsoidRadii: Any) -> None:
        """Avoid others: the mission's avoider always does."""

    def disableCollisionAvoidance(self) -> None:
        """Stop avoiding others: the mission's avoider goes on."""

    def _set(self, values: dict[str, Any], name: str, text: str) -> None:
        named = {str(key).replace("/", "."): value for key, value in values.items()}
        self._flight.set_parameters([self._row], named, name, text)
        self._parameters |= named

    def _heeds(self, mask: int) -> list[int]:
        return [row for row in super()._heeds(mask) if row == self._row]


class OldCrazyflie(Crazyflie):
    """One drone of ``pycrazyswarm``, where `position` is a method."""

    @property
    def position(self) -> Any:
        """Its position, m: a function that returns an array."""
        return lambda: np.array(self.get_position())

    def yaw(self) -> float:
        """Return its heading, rad."""
        return float(self._flight.tick.estimate.yaw[self._row])


class CrazyflieServer(_Commands):
    """All drones, and broadcasts to them."""

    def __init__(self, flight: ScriptFlight, drones: list[Crazyflie]) -> None:
        self._flight = flight
        self.crazyflies = drones
        self.crazyfliesById = {drone.id: drone for drone in drones}
        self.crazyfliesByName = {drone.name: drone for drone in drones}

    def emergency(self) -> None:
        """Stop all motors."""
        self._flight.stop_motors(range(len(self.crazyflies)))

    def goTo(
        self, goal: Sequence[float], yaw: float, duration: float, groupMask: int = 0
    ) -> None:  # fmt: skip
        """Fly by an offset, m, and a turn, rad, in some time, s."""
        rows = self._heeds(groupMask)
        self._flight.go_to(rows, goal, float(yaw), float(duration), relative=True)

    def startTrajectory(
        self,
        trajectoryId: int,
        timescale: float = 1.0,
        reverse: bool = False,
        relative: bool = True,
        groupMask: int = 0,
    ) -> None:
        """Fly stored trajectories."""
        for row in self._heeds(groupMask):
            self.crazyflies[row].startTrajectory(trajectoryId, timescale, reverse, relative)

    def arm(self, arm: bool = True) -> None:
        """Arm all."""
        for drone in self.crazyflies:
            drone.arm(arm)

    def setParam(self, name: str, value: Any) -> None:
        """Set a parameter of all."""
        for drone in self.crazyflies:
            drone.setParam(name, value)

    def cmdFullState(
        self, pos: Sequence[float], vel: Sequence[float], acc: Sequence[float], yaw: float,
        omega: Sequence[float],
    ) -> None:  # fmt: skip
        """Send a setpoint of a full state to all."""
        for drone in self.crazyflies:
            drone.cmdFullState(pos, vel, acc, yaw, omega)


class TimeHelper:
    """Mission time, and sleeping by it."""

    def __init__(self, flight: ScriptFlight) -> None:
        self._flight = flight
        self._rate: float | None = None
        self._next = 0.0

    def time(self) -> float:
        """Return mission time, s."""
        self._flight.poll()
        return self._flight.time

    def sleep(self, duration: float) -> None:
        """Sleep for some time, s."""
        self._flight.sleep(self._flight.time + float(duration))

    def sleepForRate(self, rateHz: float) -> None:
        """Sleep so that a loop runs at a rate, 1/s."""
        if rateHz != self._rate:
            self._rate, self._next = rateHz, self._flight.time + 1.0 / rateHz
        self._flight.sleep(self._next)
        self._next += 1.0 / rateHz

    def isShutdown(self) -> bool:
        """Return whether the flight is over."""
        self._flight.poll()
        return self._flight.ended is not None


class Input:
    """The button of a joystick: Enter on hardware, and pressed after some time in simulation.

    Args:
        flight: Its time.
        delay: Mission time after which a button is pressed that a script waits for, s.
    """

    def __init__(self, flight: ScriptFlight, delay: float) -> None:
        self._flight, self._delay = flight, delay
        self._waits = 0.0  # s, since a button was last pressed

    def waitUntilButtonPressed(self) -> None:
        """Wait for the button."""
        if self._flight.realtime and sys.stdin.isatty():
            sys.stdin.readline()
        else:
            self._flight.sleep(self._flight.time + self._delay)

    def checkIfButtonIsPressed(self) -> bool:
        """Return whether the button is pressed: every so often."""
        if self._flight.time - self._waits < self._delay:
            return False
        self._waits = self._flight.time
        return True

    def waitUntilAllReleased(self) -> None:
        """Return at once: the button is never held."""


class Crazyswarm:
    """What scripts begin with.

    Attributes:
        allcfs: The drones.
        timeHelper: Mission time.
        input: The button.
    """

    flight: ScriptFlight | None = None
    drone_class: type[Crazyflie] = Crazyflie
    button_delay = 2.0  # s

    def __init__(self, *_arguments: Any, **_options: Any) -> None:
        if self.flight is None:
            raise StarError("this module is for scripts that `star script` runs")
        n = len(self.flight.scene.agents)
        drones = [self.drone_class(self.flight, row) for row in range(n)]
        self.allcfs = CrazyflieServer(self.flight, drones)
        self.timeHelper = TimeHelper(self.flight)
        self.input = Input(self.flight, self.button_delay)


def _number(name: str, row: int) -> int:
    """Return the number at the end of an agent's name, or that of its row from 1."""
    digits = name[len(name.rstrip("0123456789")) :]
    return int(digits) if digits else row + 1
