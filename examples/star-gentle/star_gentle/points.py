"""The transport ``points``: agents that follow setpoints and commands exactly."""

import numpy as np

from star_core import Order, Supervisor, Telemetry, Transform, Truth


class Points:
    # positions are in odometry frames, which lie where the agents start
    def __init__(self, scene):
        starts = np.array([agent.start for agent in scene.agents])
        n = len(starts)
        self._map_from_odom = Transform(np.array([agent.yaw for agent in scene.agents]), starts)
        self._time = 0.0
        self._position, self._yaw = np.zeros((n, 3)), np.zeros(n)
        self._velocity = np.zeros((n, 3))  # of the setpoint
        self._target = np.zeros((n, 3))  # of the command
        self._remaining = np.full(n, np.inf)  # time until the command is done, s
        self._state, self._final_state = np.zeros((2, n), int)  # now; when the command is done

    def connect(self): ...

    def wait(self, until):
        step = until - self._time
        share = np.minimum(step / self._remaining, 1.0)[:, np.newaxis]
        self._position += step * self._velocity + share * (self._target - self._position)
        self._remaining -= step
        done = self._remaining < 1e-9
        self._state[done] = self._final_state[done]
        self._remaining[done] = np.inf
        self._time = until
        return until

    def receive(self):
        n = len(self._yaw)
        return Telemetry(
            time=self._time,
            position=self._position,
            velocity=self._velocity,
            attitude=self._attitude(self._yaw),
            battery=np.full(n, 4.0),
            state=self._state,
            age=np.zeros(n),
        )

    def command(self, command):
        rows = command.agent
        flying, finished = int(Supervisor.FLYING), int(Supervisor.COMMANDER_FINISHED)
        self._velocity[rows] = 0.0
        self._target[rows] = self._position[rows]
        self._remaining[rows] = command.duration
        self._state[rows] = flying
        self._final_state[rows] = finished | (0 if command.order is Order.LAND else flying)
        if command.order is Order.STOP:
            self._remaining[rows] = np.inf
            self._state[rows] = 0
        elif command.order is Order.GOTO:
            self._target[rows] = command.position
            self._yaw[rows] = command.yaw
        else:
            self._target[rows, 2] = command.position[:, 2]

    def send(self, setpoint):
        self._velocity = np.where(setpoint.active[:, np.newaxis], setpoint.velocity, 0.0)
        self._yaw = np.where(setpoint.active, setpoint.yaw, self._yaw)
        return setpoint

    def correct(self, corrections): ...

    def truth(self):
        yaw = self._yaw + self._map_from_odom.yaw
        position = self._map_from_odom.apply(self._position)
        velocity = self._map_from_odom.turn(self._velocity)
        return Truth(self._time, position, velocity, self._attitude(yaw))

    def _attitude(self, yaw):
        return np.stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)

    def close(self): ...
