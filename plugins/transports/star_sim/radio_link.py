"""The simulated radio link: packets to the drones are late, samples from them late or lost."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Final

import numpy as np

from star_core import Array, Mask, Rows
from star_sim.airframe import CYCLE, NEVER, STEP
from star_sim.error_profile import ErrorProfile
from star_sim.estimator import SAMPLE
from star_sim.reports import describe

_STREAM: Final = 7336


class RadioLink:
    """Delays what is sent and what the drones stream, and loses some of it.

    Packets to the drones arrive in the order in which they were sent. Commands are not lost: the
    radio resends them. Of setpoints and samples each agent loses its own.

    Attributes:
        next_step: Number of the step of 2 ms before which a packet arrives next, or `NEVER`.
        newest: (N, SAMPLE) the last sample that arrived from each drone.
    """

    def __init__(self, profile: ErrorProfile, seed: int, agents: int) -> None:
        self._profile = profile
        self._random = np.random.default_rng([seed, _STREAM])
        self._packets: deque[tuple[int, Callable[[], None]]] = deque()
        self._late: list[Array] = []  # rows of samples that have not arrived, (N, SAMPLE)
        self.newest = np.zeros((agents, SAMPLE))
        self.next_step = NEVER

    def send(self, step: int, effect: Callable[[], None]) -> None:
        """Send a packet before step number `step`; `effect` is called when it arrives."""
        self._packets.append((step + round(self._profile.setpoint_delay / STEP), effect))
        self.next_step = self._packets[0][0]

    def heard(self, active: Mask) -> Mask:
        """Return which of the agents in `active`, (N,), receive the next setpoint."""
        lost = self._profile.setpoint_loss
        return active if lost == 0.0 else active & (self._random.random(len(active)) >= lost)

    def deliver(self, step: int) -> None:
        """Call the effects of the packets that have arrived before a step."""
        while self._packets and self._packets[0][0] <= step:
            self._packets.popleft()[1]()
        self.next_step = self._packets[0][0] if self._packets else NEVER

    def receive(self, samples: list[Array]) -> tuple[Rows, Array]:
        """Return the samples that arrive: the rows of their drones, (K,), and (K, SAMPLE).

        Args:
            samples: (N, SAMPLE) of the drones, one for each cycle since the last call.
        """
        self._late += samples
        count = max(0, len(self._late) - round(self._profile.report_delay / CYCLE))
        due = np.array(self._late[:count]).reshape(count, *self.newest.shape)
        self._late = self._late[count:]
        heard = self._random.random(due.shape[:2]) >= self._profile.report_loss
        agent, arrived = np.nonzero(heard)[1], due[heard]
        self.newest[agent] = arrived  # of several the last one
        return agent, arrived

    def reports(self, now: float) -> tuple[Array, Array, Array, Array, Array]:
        """Return the newest state heard of each agent, in its odometry frame.

        Args:
            now: Mission time, s.

        Returns:
            (N, 3) position, m; (N, 3) velocity, m/s; (N, 4) attitude as a unit quaternion x, y, z,
            w; (N,) age, s; (N, 2) specific force along x and y of the body, m/s².
        """
        n = len(self.newest)
        position, velocity, attitude = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 4))
        age, force = np.empty(n), np.empty((n, 2))
        columns = (position, velocity, attitude, age, force)
        describe(self.newest, math.floor(now / CYCLE + 1e-6) * CYCLE, *columns)
        return columns
