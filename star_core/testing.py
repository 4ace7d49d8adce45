"""Checks for the tests of plugin authors: whether a plugin keeps its contract.

Each check takes a plugin and raises `ContractError` at the first violation. In a plugin's tests::

    from star_core.testing import check_avoider, scene

    def test_keeps_the_contract():
        check_avoider(MyAvoider(scene(3)))
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from star_core.contracts import Avoider, Localizer, Planner
from star_core.errors import ContractError
from star_core.messages.arrays import Array, Mask
from star_core.messages.rotations import Transform
from star_core.messages.state import AgentPhase, Estimate, Goals, Health, Setpoint
from star_core.messages.telemetry import Supervisor, Telemetry
from star_core.pipeline import checked_estimate, checked_plan, checked_setpoint
from star_core.plugin_guard import require_methods
from star_core.scene import Agent, Limits, Scene
from star_core.world.world import Fence, World


def scene(n: int, *, rate: float = 20.0, limits: Limits | None = None, seed: int = 0) -> Scene:
    """Return a scene of `n` agents 1 m apart on a line, in an empty room 20 m wide and 3 m high."""
    return Scene(
        agents=tuple(Agent(f"cf{i + 1}", (i - (n - 1) / 2, 0.0, 0.0)) for i in range(n)),
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


def check_avoider(avoider: Avoider, n: int = 3) -> None:
    """Check that an avoider returns finite setpoints and keeps inactive rows inactive.

    One inactive agent is not located: its row has NaN.

    Raises:
        ContractError: It does not; the message states the rule.
    """
    require_methods(avoider, Avoider)
    now, active = _partly_located(n)
    wanted = Setpoint(velocity=np.full((n, 3), 0.3), yaw=np.zeros(n), active=active)
    safe = checked_setpoint(avoider.avoid(now, wanted), n)
    if (safe.active & ~active).any():
        raise ContractError("an inactive row came back active")


def check_planner(planner: Planner, n: int = 3) -> None:
    """Check that a planner returns finite plans and keeps rows without goals inactive.

    One agent without a goal is not located: its row has NaN.

    Raises:
        ContractError: It does not; the message states the rule.
    """
    require_methods(planner, Planner)
    now, active = _partly_located(n)
    position = np.where(active[:, None], now.position + np.array([0.5, 0.0, 0.0]), 0.0)
    zero = np.zeros(n)
    plan = checked_plan(
        planner.plan(now, Goals(position, np.zeros((n, 3)), zero, zero + 0.5, active)), n
    )
    if (plan.setpoint.active & ~active).any():
        raise ContractError("a row without a goal came back active")


def check_localizer(localizer: Localizer, n: int = 3) -> None:
    """Check that a localizer returns estimates of the right time, finite where valid.

    After its first report the last agent is not heard: its row has NaN.

    Raises:
        ContractError: It does not; the message states the rule.
    """
    require_methods(localizer, Localizer)
    for time in (0.0, 0.05, 0.1):
        silent = (np.arange(n) == n - 1) & (time > 0)
        position = np.where(silent[:, None], np.nan, np.zeros((n, 3)))
        telemetry = Telemetry(
            time=time,
            position=position,
            velocity=position,
            attitude=np.where(silent[:, None], np.nan, np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))),
            battery=np.where(silent, np.nan, 4.0),
            state=np.full(n, int(Supervisor.COMMANDER_FINISHED)),
            age=np.where(silent, time, 0.0),
        )
        answer = checked_estimate(localizer.locate(telemetry), n)
        if answer.time != time:
            raise ContractError(f"Estimate.time is {answer.time!r}, expected {time!r}")


def _partly_located(n: int) -> tuple[Estimate, Mask]:
    """Return an estimate without the first agent's position, and the others: (N,)."""
    rng = np.random.default_rng(0)
    known = np.arange(n) > 0
    position = np.where(known[:, None], rng.uniform(0.5, 2, (n, 3)), np.nan)
    velocity = np.where(known[:, None], rng.normal(0, 0.3, (n, 3)), np.nan)
    return replace(estimate(position, velocity=velocity), valid=known), known
