"""Checks a plugin author runs: does this part keep its contract?

Each check takes a made part and raises `ContractError` at the first breach. In a plugin's tests::

    from star_core.testing import check_avoider, scene

    def test_keeps_the_contract():
        check_avoider(MyAvoider(scene(3)))
"""

from __future__ import annotations

import numpy as np

from star_core.contracts import Avoider
from star_core.errors import ContractError
from star_core.frames import Transform
from star_core.scene import Agent, Limits, Scene
from star_core.swarm import AgentPhase, Estimate, Health, Setpoint
from star_core.table import Array
from star_core.world import Fence, World


def scene(n: int, *, rate: float = 20.0, limits: Limits | None = None, seed: int = 0) -> Scene:
    """A scene of `n` agents 1 m apart on a line, in an empty room 20 m wide and 3 m high."""
    return Scene(
        agents=tuple(Agent(f"cf{i + 1}", (i - (n - 1) / 2, 0.0, 0.0)) for i in range(n)),
        period=1 / rate,
        world=World("room", Fence((-10.0, -10.0, 0.0), (10.0, 10.0, 3.0))),
        limits=limits or Limits(),
        seed=seed,
    )


def estimate(position: Array, *, velocity: Array | None = None, time: float = 0.0) -> Estimate:
    """An estimate with all rows valid, 1 cm of deviation, and odometry frames that lie in the map.

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
    """The health of `n` agents in one phase, charged and just heard."""
    return Health(phase=np.full(n, int(phase)), battery=np.full(n, 4.0), age=np.zeros(n))


def check_avoider(avoider: Avoider, n: int = 3) -> None:
    """Check that an avoider answers in kind, repeatably and finitely, and leaves idle rows idle.

    Raises:
        ContractError: It does not; the message says which rule it broke.
    """
    if not isinstance(avoider, Avoider):
        raise ContractError(f"{type(avoider).__name__} has no avoid(estimate, wanted)")
    rng = np.random.default_rng(0)
    now = estimate(rng.uniform(0, 2, (n, 3)), velocity=rng.normal(0, 0.3, (n, 3)))
    active = np.arange(n) > 0
    wanted = Setpoint(velocity=np.full((n, 3), 0.3), yaw=np.zeros(n), active=active)
    safe = avoider.avoid(now, wanted)
    if not isinstance(safe, Setpoint):
        raise ContractError(f"avoid() returned {type(safe).__name__}, expected Setpoint")
    if len(safe.velocity) != n:
        raise ContractError(f"{n} agents in, {len(safe.velocity)} out")
    if not np.isfinite(safe.velocity[safe.active]).all():
        raise ContractError("a finite wish was answered by a velocity that is not")
    if (safe.active & ~active).any():
        raise ContractError("an inactive row came back active")
