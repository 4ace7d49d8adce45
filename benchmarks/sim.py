"""Speed of the simulator's inner loop, against plain numpy; and how far its estimators drift.

``python benchmarks/sim.py`` prints a table, with ``--json`` one JSON object. The peer is the naive
way to do the same: one numpy expression per line of the equations, over all agents at once. It has
the rigid body, the motors and the three control loops; the kernel has commander, supervisor,
contacts, battery and the noisy estimator on top. Both are timed in turns, as medians.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

import numpy as np
from printed import command_line, show

from star_core import Agent, Array, Command, Fence, Order, Scene, Setpoint, World
from star_sim import airframe, attitude, ideal_world, position
from star_sim.drone import VELOCITY
from star_sim.error_profile import IDEAL, REALISTIC, ErrorProfile
from star_sim.transport import Simulator

RATE = 20  # Hz, ticks
STEPS = 25  # of 2 ms in a tick
AGENTS = (1, 10, 1000)
ROUNDS, REPEATS, TIMES = 5, 7, 400  # of all sides, of one side, of one call with one agent
LAPS = 3


class NumpySwarm:
    """The peer: N drones that fly velocity setpoints in free air and know where they are."""

    def __init__(self, place: Array, heading: Array) -> None:
        n = len(place)
        self.position, self.velocity = place.copy(), np.zeros((n, 3))
        self.attitude = np.zeros((n, 4))
        self.attitude[:, 2], self.attitude[:, 3] = np.sin(heading / 2), np.cos(heading / 2)
        self.rates, self.thrust, self.windup = np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3))
        self.start_yaw = heading

    def tick(self, velocity: Array, yaw: Array, steps: int) -> None:
        """Fly velocities, m/s, and yaws, rad, given in each odometry frame."""
        for step in range(steps):
            if step % airframe.STEPS_PER_CYCLE == 0:
                push, yaw_rate = self._aim(velocity, yaw)
            self._step(push, yaw_rate)

    def _aim(self, velocity: Array, yaw: Array) -> tuple[Array, Array]:
        """Velocity PI, limits of lift and tilt; in the odometry frame, then in the map."""
        turn = -self.start_yaw
        missing = velocity - _turn(self.velocity, turn)
        limit = position.INTEGRAL_LIMIT
        self.windup += position.INTEGRAL_GAIN * airframe.CYCLE * missing
        self.windup = np.clip(self.windup, -limit, limit)
        gain = np.array([position.VELOCITY_GAIN, position.VELOCITY_GAIN, position.CLIMB_GAIN])
        push = airframe.MASS * (gain * missing + self.windup)
        push[:, 2] += airframe.MASS * airframe.GRAVITY
        push[:, 2] = np.clip(push[:, 2], position.LEAST_LIFT, position.MOST_LIFT)
        aside = np.maximum(1e-9, np.hypot(push[:, 0], push[:, 1]))
        push[:, :2] *= np.minimum(1, position.TANGENT_LIMIT * push[:, 2] / aside)[:, None]
        x, y, z, w = self.attitude.T
        believed = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)) + turn
        error = np.remainder(yaw - believed + np.pi, 2 * np.pi) - np.pi
        limit = position.YAW_RATE_LIMIT
        return _turn(push, self.start_yaw), np.clip(position.YAW_GAIN * error, -limit, limit)

    def _step(self, push: Array, yaw_rate: Array) -> None:
        """Attitude and rate loops, mixer, motors, Newton and Euler: one step of 2 ms."""
        a = airframe
        x, y, z, w = self.attitude.T
        frame = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )  # (3, 3, N) from the body to the map
        inside = np.einsum("ijn,ni->nj", frame, push)
        ahead, aside, lift = inside.T / np.linalg.norm(push, axis=1)
        lift = np.maximum(0, inside[:, 2])
        target = np.stack([-attitude.ATTITUDE_GAIN * aside, attitude.ATTITUDE_GAIN * ahead], axis=1)
        torque = a.INERTIA_XY * attitude.RATE_GAIN * (target - self.rates[:, :2]) / (4 * a.ARM)
        roll, pitch = torque.T
        turn = a.INERTIA_Z * attitude.YAW_RATE_GAIN * (yaw_rate - self.rates[:, 2])
        turn /= 4 * a.TORQUE_PER_THRUST
        motors = lift[:, None] / 4 + np.stack(
            [-roll - pitch - turn, -roll + pitch + turn, roll + pitch - turn, roll - pitch + turn],
            axis=1,
        )
        motors -= np.maximum(0, motors.max(axis=1) - a.THRUST_MAX)[:, None]
        self.thrust += a.MOTOR_STEP * (np.maximum(motors, a.THRUST_MIN) - self.thrust)

        first, second, third, fourth = self.thrust.T
        inertia = np.array([a.INERTIA_XY, a.INERTIA_XY, a.INERTIA_Z])
        moment = np.stack(
            [
                a.ARM * (-first - second + third + fourth),
                a.ARM * (-first + second + third - fourth),
                a.TORQUE_PER_THRUST * (-first + second - third + fourth),
            ],
            axis=1,
        ) - np.cross(self.rates, inertia * self.rates)
        self.rates += a.STEP * moment / inertia
        axes = np.einsum("ijn,ni->nj", frame, self.velocity)
        force = -np.array([a.DRAG_XY, a.DRAG_XY, a.DRAG_Z]) * axes
        force[:, 2] += self.thrust.sum(axis=1)
        self.velocity += a.STEP / a.MASS * np.einsum("ijn,nj->ni", frame, force)
        self.velocity[:, 2] -= a.STEP * a.GRAVITY
        p, q, r = self.rates.T
        change = [w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p]
        change.append(-x * p - y * q - z * r)
        self.attitude = self.attitude + 0.5 * a.STEP * np.stack(change, axis=1)
        self.attitude /= np.linalg.norm(self.attitude, axis=1, keepdims=True)
        self.position += a.STEP * self.velocity


def _turn(vectors: Array, yaw: Array) -> Array:
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y, z = vectors.T
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)


def grid(n: int, spacing: float, seed: int = 0) -> Scene:
    """A scene of `n` agents on a square grid, m apart, in the open."""
    side = math.ceil(math.sqrt(n))
    wide = spacing * (side + 1)
    agents = tuple(
        Agent(f"cf{i + 1}", (spacing * (i % side), spacing * (i // side), 0.0)) for i in range(n)
    )
    world = World("open", Fence((-wide, -wide, 0.0), (2 * wide, 2 * wide, 3.0)))
    return Scene(agents, 1 / RATE, world, seed=seed)


def hover(
    n: int, *, noise: bool = True, controller: str = "ideal", profile: ErrorProfile = IDEAL
) -> Simulator:
    """A connected simulator with `n` drones in the air, steered by setpoints."""
    simulator = Simulator(
        grid(n, 1.0), **ideal_world(noise=noise, controller=controller, profile=profile)
    )
    simulator.connect()
    simulator.drones["position"][:, 2] = simulator.drones["seen_position"][:, 2] = 1.0
    simulator.drones["believed_position"][:, 2] = 1.0
    simulator.drones["mode"] = VELOCITY
    simulator.drones["setpoint_time"] = math.inf  # never silent
    simulator.drones["thrust"] = airframe.HOVER_THRUST
    return simulator


def seconds(call: Callable[[], object], times: int) -> float:
    """Median CPU time of one call, s."""
    took = []
    for _ in range(REPEATS):
        began = time.thread_time()
        for _ in range(times):
            call()
        took.append((time.thread_time() - began) / times)
    return statistics.median(took)


def speed(n: int) -> dict[str, float]:
    """Agent-steps per second of kernel, whole transport and peer, and the kernel's ratios."""
    simulator, quiet, whole = hover(n), hover(n, noise=False), hover(n)
    cascade = hover(n, controller="pid")
    realistic = hover(n, controller="pid", profile=REALISTIC)
    mellinger = hover(n, controller="mellinger", profile=REALISTIC)
    peer = NumpySwarm(quiet.drones["position"].copy(), np.zeros(n))
    still, zero = np.zeros((n, 3)), np.zeros(n)
    tick = 0

    def transport_tick() -> None:
        nonlocal tick
        tick += 1
        whole.wait(tick / RATE)
        whole.receive()

    times = max(1, TIMES // n)
    rounds = [
        (
            seconds(lambda: simulator._advance(STEPS), times),  # noqa: SLF001
            seconds(lambda: quiet._advance(STEPS), times),  # noqa: SLF001
            seconds(transport_tick, times),
            seconds(lambda: peer.tick(still, zero, STEPS), max(1, times // 20)),
            seconds(lambda: cascade._advance(STEPS), times),  # noqa: SLF001
            seconds(lambda: realistic._advance(STEPS), times),  # noqa: SLF001
            seconds(lambda: mellinger._advance(STEPS), times),  # noqa: SLF001
        )
        for _ in range(ROUNDS)
    ]
    work = n * STEPS
    kernel, silent, transport, naive, firmware, world, other = (
        work / statistics.median(column) for column in zip(*rounds, strict=True)
    )
    ratio = statistics.median(round_[3] / round_[0] for round_ in rounds)
    return {
        f"kernel_agent_steps_per_s_n{n}": kernel,
        f"kernel_pid_agent_steps_per_s_n{n}": firmware,
        f"kernel_pid_realistic_agent_steps_per_s_n{n}": world,
        f"kernel_mellinger_realistic_agent_steps_per_s_n{n}": other,
        f"kernel_pid_over_ideal_n{n}": statistics.median(row[0] / row[4] for row in rounds),
        f"kernel_without_noise_agent_steps_per_s_n{n}": silent,
        f"transport_agent_steps_per_s_n{n}": transport,
        f"numpy_agent_steps_per_s_n{n}": naive,
        f"kernel_over_numpy_n{n}": ratio,
    }


def drift(agents: int = 20, laps: int = 3, side: float = 2.37, cruise: float = 0.28) -> Array:
    """Mean squared error of what drones believe of their place over laps of a box, m² per drone.

    The drones are guided by the truth at 0.8 m with their heading along the path, 6 m apart, so
    that each sees a floor and has errors of its own. A corner is turned on the spot at 48 °/s.
    """
    simulator = Simulator(grid(agents, 6.0), **ideal_world())
    simulator.connect()
    rows = np.arange(agents)
    height = np.tile([0.0, 0.0, 0.8], (agents, 1))
    zero = np.zeros(agents)
    simulator.command(Command(Order.TAKEOFF, rows, height, zero, zero + 3))
    simulator.wait(4.0)
    leg, corner = side / cruise, 90 / 48
    start = np.array([agent.start for agent in simulator._scene.agents])  # noqa: SLF001
    squared = []
    for tick in range(int(4 * laps * (leg + corner) * RATE)):
        side_number, within = divmod(tick / RATE, leg + corner)
        along = min(within * cruise, side)
        heading = side_number % 4 * math.pi / 2
        corners = side * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        ahead = np.array([math.cos(heading), math.sin(heading)])
        place = start[:, :2] + corners[int(side_number) % 4] + along * ahead
        heading += max(0.0, within - leg) / corner * math.pi / 2
        drones = simulator.drones
        truth = drones["position"]
        velocity = np.zeros((agents, 3))
        velocity[:, :2] = 1.0 * (place - truth[:, :2]) + (cruise * ahead if within < leg else 0)
        velocity[:, 2] = 0.8 - truth[:, 2]
        slip = np.arctan2(drones["slip"][:, 1], drones["slip"][:, 0])  # believed less true yaw
        simulator.send(Setpoint(_turn(velocity, slip), heading + slip, np.ones(agents, np.bool_)))
        simulator.wait(4.0 + (tick + 1) / RATE)
        error = drones["believed_position"] + start - drones["position"]
        squared.append((error**2).sum(axis=1))
    return np.array(np.mean(squared, axis=0))


def main() -> None:
    options = command_line(__doc__).parse_args()
    figures: dict[str, float] = {}
    for n in AGENTS:
        figures |= speed(n)
    error = drift(laps=LAPS)
    figures["drift_box_mse_m2_mean"] = float(error.mean())
    figures["drift_box_mse_m2_std"] = float(error.std(ddof=1))
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
