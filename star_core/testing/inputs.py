"""Scenes and tables as they occur in flight, for tests of plugins."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.rotations import Transform
from star_core.messages.state import AgentPhase, Estimate, Health
from star_core.messages.telemetry import Frames, Supervisor, Telemetry
from star_core.world.scene import Agent, Limits, Scene
from star_core.world.world import Fence, World

ROW: Final = 10  # agents of a scene in a line


def scene(n: int, *, rate: float = 20.0, limits: Limits | None = None, seed: int = 0) -> Scene:
    """Return a scene of `n` agents 1 m apart, up to 10 on a line, in an empty room 20 m wide."""
    columns, lines = min(n, ROW), -(-n // ROW)
    starts = ((i % ROW - (columns - 1) / 2, i // ROW - (lines - 1) / 2, 0.0) for i in range(n))
    return Scene(
        agents=tuple(Agent(f"cf{i + 1}", start) for i, start in enumerate(starts)),
        period=1 / rate,
        world=World("room", Fence((-10.0, -10.0, 0.0), (10.0, 10.0, 3.0))),
        limits=limits or Limits(),
        seed=seed,
    )


def estimate(position: Array, *, velocity: Array | None = None, time: float = 0.0) -> Estimate:
    """Return an estimate with all rows valid, a deviation of 1 cm, and frames equal to the map.

    Args:
        position: (N, 3) m.
        velocity: (N, 3) m/s; at rest if not given.
        time: Mission time, s.
    """
    n = len(position)
    return Estimate(
        time=time,
        position=position,
        velocity=np.zeros((n, 3)) if velocity is None else velocity,
        yaw=np.zeros(n),
        covariance=np.tile(np.eye(3) * 1e-4, (n, 1, 1)),
        valid=np.ones(n, np.bool_),
        map_from_odom=Transform(np.zeros(n), np.zeros((n, 3))),
    )


def health(n: int, phase: AgentPhase = AgentPhase.FLYING) -> Health:
    """Return the health of `n` agents in one phase, charged and just heard."""
    return Health(phase=np.full(n, int(phase)), battery=np.full(n, 4.0), age=np.zeros(n))


def situations(room: Scene) -> Iterator[tuple[str, Estimate, Mask]]:
    """Yield what avoiders and planners meet in flight: a label, an estimate, the agents that fly.

    Args:
        room: Where agents fly at 1 m above their starts.
    """
    n = len(room.agents)
    draw = np.random.default_rng(n)
    position = np.array([agent.start for agent in room.agents]) + np.array([0.0, 0.0, 1.0])
    velocity = draw.uniform(-0.3, 0.3, (n, 3))
    flying = np.ones(n, np.bool_)
    first, odd = np.arange(n) == 0, np.arange(n) % 2 == 1
    now = estimate(position, velocity=velocity)
    yield "all fly", now, flying
    gone = np.where(first, np.nan, 0.0)
    lost = estimate(position + gone[:, None], velocity=velocity + gone[:, None], time=room.period)
    lost = replace(lost, yaw=gone, valid=~first)
    yield "agent 0 is not located, its row is NaN", lost, ~first
    low = position * np.where(odd, [[1.0], [1.0], [0.0]], 1.0).T
    yield "every second agent has landed", estimate(low, time=2 * room.period), ~odd
    stacked = np.tile(position[:1], (n, 1))
    yield "all are at one point", estimate(stacked, time=3 * room.period), flying
    travel = np.where(first[:, None], [0.5, 0.0, 0.0], 0.0)
    unheard = replace(now, time=4 * room.period, valid=~first, possible_travel=travel)
    yield "agent 0 is not heard", unheard, ~first
    yield "no agent flies", replace(now, time=5 * room.period), np.zeros(n, np.bool_)


def flight_telemetry(room: Scene, time: float, silent: Mask, unknown: Mask) -> Telemetry:
    """Return telemetry of agents that fly along x; NaN for those whose position is not known.

    Cameras send black images.
    """
    n = len(room.agents)
    cameras = {row: agent.camera for row, agent in enumerate(room.agents) if agent.camera}
    moments = np.full(len(cameras), time)
    images = tuple(np.zeros((camera.height, camera.width), np.uint8) for camera in cameras.values())
    nan = np.where(unknown, np.nan, 0.0)
    velocity = np.tile([0.2, 0.0, 0.0], (n, 1)) + nan[:, None]
    return Telemetry(
        time=time,
        position=velocity * time,
        velocity=velocity,
        attitude=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)) + nan[:, None],
        battery=4.0 + nan,
        state=np.full(n, int(Supervisor.FLYING)),
        age=np.where(silent, 0.3, 0.0),
        frames=Frames(np.array([*cameras], np.int64), moments, moments, images),
    )
