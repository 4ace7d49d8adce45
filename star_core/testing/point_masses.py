"""Agents that are points: a transport that follows setpoints and commands exactly."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.commands import Command, Order, Trajectory
from star_core.messages.rotations import Transform, wrap_angle
from star_core.messages.state import AgentPhase, Estimate, Goals, Health, Setpoint, Truth
from star_core.messages.telemetry import Corrections, Supervisor, Telemetry

CHARGED: Final = 4.2  # V
CLOCK_ERROR: Final = 1e-9  # s, rounding error of a sum of ticks
AT_GOAL: Final = 1e-9  # m: nearer than this there is no direction to a goal
IN_FLIGHT: Final = (AgentPhase.TAKING_OFF, AgentPhase.FLYING, AgentPhase.LANDING)
AFTER: Final = {Order.TAKEOFF: AgentPhase.FLYING, Order.LAND: AgentPhase.LANDED}
"""Phases of agents after a command; after any other they fly."""


class PointMasses:
    """A transport to points.

    They fly the velocity of a setpoint as soon as `acceleration` permits, and a command within its
    duration: a trajectory exactly, everything else along a straight line. They turn at once.

    Args:
        position: (N, 3) at the start, each in its odometry frame, m.
        yaw: (N,) likewise, rad; 0 if None.
        frames: From each agent's odometry frame to the map; None if all of them are the map.
        phase: Of all agents at the start.
        acceleration: Greatest change of their velocities by setpoints, m/s².
        settling: Time from the end of a commanded climb or descent to the end of its phase, s.

    Attributes:
        time: Mission time, s.
        position: (N, 3) in odometry frames, m.
        velocity: (N, 3) likewise, m/s.
        yaw: (N,) likewise, rad.
        phase: (N,) `AgentPhase`.
    """

    def __init__(
        self,
        position: Array,
        yaw: Array | None = None,
        *,
        frames: Transform | None = None,
        phase: AgentPhase = AgentPhase.GROUNDED,
        acceleration: float = np.inf,
        settling: Mapping[Order, float] = MappingProxyType({}),
    ) -> None:
        n = len(position)
        self.time = 0.0
        self.position = np.array(position, np.float64)
        self.velocity = np.zeros((n, 3))
        self.yaw = np.zeros(n) if yaw is None else np.array(yaw, np.float64)
        self.phase = np.full(n, int(phase))
        self._frames = frames or Transform(np.zeros(n), np.zeros((n, 3)))
        self._acceleration = acceleration
        self._settling = settling
        self._setpoint = np.zeros((n, 3))  # m/s
        self._commanded = np.zeros(n, np.bool_)  # its command is not over
        self._finished = np.zeros(n, np.bool_)  # it was, and no other came since
        self._target = self.position.copy()  # m, of the command
        self._until = np.full(n, np.inf)  # s, end of the motion that the command asks for
        self._over = np.full(n, np.inf)  # s, end of its phase
        self._after = np.full(n, int(AgentPhase.FLYING))  # phase at that time
        self._trajectories: dict[int, _OnBoard] = {}  # by row
        self._exact = Estimate(
            time=0.0,
            position=self.position,
            velocity=self.velocity,
            yaw=self.yaw,
            covariance=np.zeros((n, 3, 3)),
            valid=np.ones(n, np.bool_),
            map_from_odom=self._frames,
        )
        self._healthy = Health(self.phase, np.full(n, CHARGED), np.zeros(n))

    def connect(self) -> None:
        """Open the links, of which there are none."""

    def close(self) -> None:
        """Close the links, of which there are none."""

    def correct(self, corrections: Corrections) -> None:
        """Ignore corrections: positions are exact."""

    def wait(self, until: float) -> float:
        """Advance to a time, s, and return it."""
        elapsed = until - self.time
        change = self._setpoint - self.velocity
        if np.isfinite(self._acceleration):
            most = self._acceleration * elapsed
            norm = np.sqrt(np.vecdot(change, change))
            change *= np.minimum(1.0, most / np.maximum(norm, most))[:, None]
        self.velocity += change
        self.position += elapsed * self.velocity
        if self._commanded.any():
            self._fly_commands(until)
        self.time = until
        return until

    def _fly_commands(self, until: float) -> None:
        """Move agents by their commands, until a time, s."""
        left = np.maximum(self._until - self.time, CLOCK_ERROR)
        share = np.where(np.isfinite(left), np.minimum((until - self.time) / left, 1.0), 0.0)
        self.position += share[:, None] * (self._target - self.position)
        for row, flight in self._trajectories.items():
            self.position[row], self.yaw[row] = flight.at(until)
        still = self._until <= until + CLOCK_ERROR
        self._until[still] = np.inf
        over = self._over <= until + CLOCK_ERROR
        self.phase[over] = self._after[over]
        self._end_commands(over)
        self._finished |= over

    def _end_commands(self, rows: Mask) -> None:
        """End the commands of some rows, (N,)."""
        if not rows.any():
            return
        for row in [row for row in self._trajectories if rows[row]]:
            del self._trajectories[row]
        self._commanded[rows] = False
        self._until[rows] = self._over[rows] = np.inf

    def receive(self) -> Telemetry:
        """Return the state of all agents, in odometry frames."""
        n, half = len(self.phase), self.yaw / 2
        flies = np.isin(self.phase, IN_FLIGHT)
        state = np.where(flies, int(Supervisor.FLYING), 0)
        state |= np.where(self._finished, int(Supervisor.COMMANDER_FINISHED), 0)
        return Telemetry(
            time=self.time,
            position=self.position.copy(),
            velocity=self.velocity.copy(),
            attitude=np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1),
            battery=np.full(n, CHARGED),
            state=state,
            age=np.zeros(n),
        )

    def command(self, command: Command) -> None:
        """Begin to fly a command."""
        rows, order = command.agent, command.order
        if order is Order.ARM:
            return
        stops = order is Order.STOP
        self._end_commands(self._among(rows.tolist()))
        self._finished[rows] = False
        self._commanded[rows] = not stops
        self.velocity[rows] = self._setpoint[rows] = 0.0
        phases = {
            Order.TAKEOFF: AgentPhase.TAKING_OFF,
            Order.LAND: AgentPhase.LANDING,
            Order.STOP: AgentPhase.LANDED,
        }
        self.phase[rows] = phases.get(order, AgentPhase.FLYING)
        if stops:
            return
        self._after[rows] = AFTER.get(order, AgentPhase.FLYING)
        self._until[rows] = self.time + command.duration
        self._over[rows] = self._until[rows] + self._settling.get(order, 0.0)
        self._target[rows] = self.position[rows]
        if command.trajectory is not None:
            for k, row in enumerate(rows.tolist()):
                self._trajectories[row] = _OnBoard(command, k, command.trajectory, self.time)
        elif order is Order.GOTO:
            self._target[rows] = command.position
            self.yaw[rows] = command.yaw
        else:
            self._target[rows, 2] = np.maximum(command.position[:, 2], 0.0)  # the floor

    def send(self, setpoint: Setpoint) -> Setpoint:
        """Fly the velocities of a setpoint; agents without one stop, unless a command moves them.

        A setpoint ends a flight on board, but no climb and no descent.
        """
        active = setpoint.active
        self._setpoint = np.where(active[:, None], setpoint.velocity, 0.0)
        self.yaw = np.where(active, setpoint.yaw, self.yaw)
        if self._commanded.any():
            self._end_commands(active & self._commanded & (self.phase == AgentPhase.FLYING))
        return setpoint

    def truth(self) -> Truth | None:
        """Return where the agents are."""
        attitude = np.tile([0.0, 0.0, 0.0, 1.0], (len(self.yaw), 1))
        return Truth(self.time, self._frames.apply(self.position), self.velocity.copy(), attitude)

    # What a localizer and the core make of their telemetry, without a flight:

    def estimate(self) -> Estimate:
        """Return the exact estimate of all agents, in the map."""
        frames = self._frames
        return replace(
            self._exact,
            time=self.time,
            position=frames.apply(self.position),
            velocity=frames.turn(self.velocity),
            yaw=wrap_angle(self.yaw + frames.yaw),
        )

    def health(self) -> Health:
        """Return the health of all agents: charged and connected."""
        healthy = self._healthy
        return Health.made(self.phase.copy(), healthy.battery, healthy.age, healthy.finder)

    def steered(self) -> Mask:
        """Return which agents setpoints fly: those in the air without a command, (N,)."""
        flies: Mask = (self.phase == AgentPhase.FLYING) & ~self._commanded
        return flies

    def release(self, rows: Collection[int]) -> None:
        """Let setpoints fly some rows, whatever they fly on board; climbs and descents go on."""
        if rows and self._commanded.any():
            flies = self._commanded & (self.phase == AgentPhase.FLYING)
            self._end_commands(flies & self._among(rows))

    def _among(self, rows: Collection[int]) -> Mask:
        """Return which agents are of some rows, (N,)."""
        among = np.zeros(len(self.phase), np.bool_)
        among[[*rows]] = True
        return among


class _OnBoard(NamedTuple):
    """A trajectory that an agent flies.

    Attributes:
        command: By which it flies.
        row: Of the agent in the command.
        trajectory: Of the command.
        begun: s.
    """

    command: Command
    row: int
    trajectory: Trajectory
    begun: float

    def at(self, time: float) -> tuple[Array, float]:
        """Return the position, (3,) m, and the yaw, rad, at a time, s."""
        command, row = self.command, self.row
        share = min((time - self.begun) / float(command.duration[row]), 1.0)
        ends = self.trajectory.duration.cumsum()
        elapsed = share * ends[-1]
        piece = min(int(ends.searchsorted(elapsed, "right")), len(ends) - 1)
        since = elapsed - ends[piece] + self.trajectory.duration[piece]
        x, y, z, yaw = self.trajectory.coefficients[piece] @ since ** np.arange(8)
        cos, sin = np.cos(command.yaw[row]), np.sin(command.yaw[row])
        turned = np.array([cos * x - sin * y, sin * x + cos * y, z])
        return command.position[row] + turned, float(command.yaw[row] + yaw)


def straight_velocity(
    position: Array,
    goals: Goals,
    period: float,
    *,
    gain: float = np.inf,
    braking: float = np.inf,
    limit: float = np.inf,
) -> Array:
    """Return (N, 3) velocities, m/s, that lead straight to goals.

    At distance ``d`` from its goal the speed of an agent is the least of the goal's speed,
    ``gain d``, ``sqrt(2 braking d)``, as by `PositionController`, and ``d / period``. The goal's
    velocity is added; the sum is at most the goal's speed and `limit`.

    Args:
        position: (N, 3) of the agents, m.
        goals: Of the agents; the velocity of those without one is 0.
        period: Time until the next velocities, s.
        gain: Speed by distance, 1/s.
        braking: Deceleration, m/s².
        limit: Of any speed, m/s.
    """
    offset = goals.position - position
    distance = np.maximum(np.sqrt(np.vecdot(offset, offset)), AT_GOAL)
    closing = np.minimum(goals.speed, distance * min(gain, 1 / period))
    closing = np.minimum(closing, np.sqrt(2 * braking * distance))
    velocity = offset * (closing / distance)[:, None] + goals.velocity
    speed = np.maximum(np.sqrt(np.vecdot(velocity, velocity)), AT_GOAL)
    velocity *= np.minimum(1.0, np.minimum(goals.speed, limit) / speed)[:, None]
    return np.where(goals.active[:, None], velocity, 0.0)
