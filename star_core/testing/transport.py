"""The check of transports: a flight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from star_core.contracts import Transport
from star_core.errors import ContractError
from star_core.messages.arrays import Mask
from star_core.messages.commands import Command, Order
from star_core.messages.state import Setpoint
from star_core.messages.telemetry import Corrections, Supervisor, Telemetry
from star_core.plugin_support.guard import require_methods
from star_core.plugin_support.outputs import (
    TIME_TOLERANCE,
    checked_setpoint,
    checked_telemetry,
    checked_time,
    checked_truth,
)
from star_core.testing.calls import (
    SIZES,
    Times,
    agents_of,
    called_alike,
    close_all,
    labeled,
    reported,
)
from star_core.testing.inputs import scene
from star_core.world.scene import Scene

MAX_ERROR: Final = 0.2  # m, of agents that a transport flies

# of a transport: label, command, duration (a command takes half of it), velocity of the setpoints
# along x, m/s, position at the end in the odometry frame: x and z, m
FLIGHT: Final = (
    ("before the take-off", None, 0.5, None, (0.0, 0.0)),
    ("after a take-off", Order.TAKEOFF, 4.0, None, (0.0, 0.6)),
    ("with setpoints along x", None, 2.0, 0.2, (0.4, 0.6)),
    ("with setpoints of zero velocity", None, 0.5, 0.0, (0.45, 0.6)),
    ("after a landing", Order.LAND, 6.0, None, (0.45, 0.0)),
)


def check_transport(
    make: Callable[[Scene], Transport],
    scene: Callable[[int], Scene] = scene,
    *,
    deterministic: bool = True,
) -> Times:
    """Check a transport by a flight: every second agent takes off, flies a setpoint and lands.

    Args:
        make: Makes the transport for a scene.
        scene: As of all checks.
        deterministic: Whether two transports made alike do the same, as a simulation should.

    Raises:
        ContractError: The agents do not do that, or a table breaks its contract.
    """
    means = {}
    for n in SIZES:
        room = scene(n)
        links = [make(room) for _ in range(1 + deterministic)]
        require_methods(links[0], Transport)
        took: list[float] = []
        for link in links:
            link.connect()
        try:
            _fly(links, room, took)
        finally:
            close_all(links)
        close_all(links)  # it may be called twice
        means[n] = float(np.mean(took))
    return reported(links[0], means)


def _fly(links: Sequence[Transport], room: Scene, took: list[float]) -> None:
    """Fly every second agent of a transport along `FLIGHT`, and check where all are then."""
    n = len(room.agents)
    flown, rows = np.arange(n) % 2 == 0, np.arange(0, n, 2)
    now = 0.0

    def call(method: str, *inputs: Any) -> Any:
        output, elapsed = called_alike(links, method, inputs)
        took.append(elapsed)
        return output

    def tick(velocity: float | None) -> Telemetry:
        nonlocal now
        now = checked_time(call("wait", now + room.period), now + room.period)
        telemetry = checked_telemetry(call("receive"), n)
        if telemetry.time > now + TIME_TOLERANCE:
            raise ContractError(f"Telemetry.time is {telemetry.time!r}, later than {now!r}")
        checked_truth(call("truth"), n)
        if velocity is not None:
            speeds = np.where(flown[:, None], [velocity, 0.0, 0.0], 0.0)
            checked_setpoint(call("send", Setpoint(speeds, np.zeros(n), flown)), n)
        return telemetry

    for label, order, seconds, velocity, (x, z) in FLIGHT:
        with labeled(f"transport of {agents_of(n)}, {label}"):
            if order is not None:
                target = np.tile([0.0, 0.0, z], (len(rows), 1))
                last = np.full(len(rows), seconds / 2)
                call("command", Command(order, rows, target, 0.0 * last, last))
            for _ in range(round(seconds / room.period)):
                telemetry = tick(velocity)
            _require_flown(telemetry, flown, (x, z), commanded=order is not None)
    with labeled(f"transport of {agents_of(n)}, with a correction"):
        std = np.full(1, 0.01)
        level = np.array([[0.0, 0.0, 0.0, 1.0]])
        call("correct", Corrections(rows[:1], telemetry.position[:1], level, std, std))


def _require_flown(
    telemetry: Telemetry, flown: Mask, end: tuple[float, float], *, commanded: bool
) -> None:
    """Check that the agents that were flown are at x and z, m, and the others at their starts."""
    x, z = end
    expected = np.where(flown[:, None], [x, 0.0, z], 0.0)
    error = np.abs(telemetry.position - expected).max(axis=1)
    flying, finished = (
        telemetry.state & int(flag) != 0
        for flag in (Supervisor.FLYING, Supervisor.COMMANDER_FINISHED)
    )
    for wrong, rule in (
        (
            ~(error < MAX_ERROR),
            f"is {error.round(2).tolist()} m from where it is expected: agents fly commands and "
            "active rows of setpoints, positions are in the frame of their starts",
        ),
        (
            flying != (flown & (z > 0)),
            "must report Supervisor.FLYING in the air, and not on the ground: take-offs and "
            "landings wait for that",
        ),
        (
            ~finished & flown & commanded,
            "must report Supervisor.COMMANDER_FINISHED after a command: tasks wait for it",
        ),
    ):
        if wrong.any():
            raise ContractError(f"row {int(np.argmax(wrong))} {rule}")
