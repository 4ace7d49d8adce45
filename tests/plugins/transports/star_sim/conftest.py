"""A simulated swarm that a line of code commands."""

from __future__ import annotations

import dataclasses
import runpy
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_core import Agent, Array, Command, Obstacle, Order, Setpoint, Supervisor
from star_core.testing import scene
from tests.simulators import ideal_simulator


class Flight:
    """A simulator and its clock, ticked at 20 Hz."""

    def __init__(
        self,
        n: int = 1,
        *,
        at: Sequence[tuple[float, float, float]] | None = None,
        yaw: float = 0.0,
        obstacles: tuple[Obstacle, ...] = (),
        rate: float = 20.0,
        seed: int = 0,
        noise: bool = False,
        **options: Any,
    ) -> None:
        room = scene(n, rate=rate, seed=seed)
        places = at or [agent.start for agent in room.agents]
        room = dataclasses.replace(
            room,
            agents=tuple(Agent(f"cf{i + 1}", place, yaw) for i, place in enumerate(places)),
            world=dataclasses.replace(room.world, obstacles=obstacles),
        )
        self.simulator: Any = ideal_simulator(room, noise=noise, **options)
        self.simulator.connect()
        self.n, self.period, self.ticks = len(places), room.period, 0
        self.telemetry: Any = self.simulator.receive()

    @property
    def position(self) -> Array:
        """True positions, (N, 3)."""
        position: Array = self.simulator.truth().position
        return position

    def state(self, row: int = 0) -> Supervisor:
        return Supervisor(int(self.telemetry.state[row]))

    def order(
        self,
        order: Order,
        at: Sequence[float] = (0.0, 0.0, 0.0),
        *,
        yaw: float = 0.0,
        duration: float = 2.0,
        rows: Sequence[int] | None = None,
    ) -> None:
        chosen = np.arange(self.n) if rows is None else np.array(rows)
        self.simulator.command(
            Command(
                order,
                chosen,
                np.tile(at, (len(chosen), 1)),
                np.full(len(chosen), yaw),
                np.full(len(chosen), duration),
            )
        )

    def rise(self, height: float = 0.8) -> None:
        """Take off, settle, and hover from then on: a take-off alone would come down again."""
        self.order(Order.TAKEOFF, (0.0, 0.0, height))
        self.fly(2.5)
        self.hover()
        self.fly(1.5)

    def hover(self) -> None:
        """Go to where the commanders are: they then hover until the batteries are empty."""
        drones, rows = self.simulator.drones, np.arange(self.n)
        top, yaw = drones["reference_position"], drones["reference_yaw"]
        self.simulator.command(Command(Order.GOTO, rows, top, yaw, np.ones(self.n)))

    def fly(
        self,
        seconds: float,
        velocity: Any = None,
        *,
        yaw: float = 0.0,
        rows: Sequence[int] | None = None,
    ) -> list[Any]:
        """Return the telemetry of some time, in which a velocity is sent in each tick if given."""
        heard = []
        active = np.isin(np.arange(self.n), np.arange(self.n) if rows is None else rows)
        for _ in range(round(seconds / self.period)):
            if velocity is not None:
                velocities = np.broadcast_to(np.asarray(velocity, float), (self.n, 3))
                self.simulator.send(Setpoint(velocities, np.full(self.n, yaw), active))
            self.ticks += 1
            self.simulator.wait(self.ticks * self.period)
            self.telemetry = self.simulator.receive()
            heard.append(self.telemetry)
        return heard


def hovering(n: int = 1, *, height: float = 0.8, **options: Any) -> Flight:
    """Return a swarm that has taken off, and hovers."""
    flight = Flight(n, **options)
    flight.rise(height)
    return flight


@cache
def benchmark() -> dict[str, Any]:
    """Return the names of ``benchmarks/sim.py``, which imports others of its folder."""
    folder = Path(__file__).parents[4] / "benchmarks"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        return runpy.run_path(str(folder / "sim.py"))
