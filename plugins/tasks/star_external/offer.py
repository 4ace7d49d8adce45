"""What ``external`` takes, as JSON Schema, and how its task is made."""

from __future__ import annotations

import logging
from functools import partial
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Any, Final

from star_core import Offer
from star_external.checks import check

if TYPE_CHECKING:
    from star_core import Scene, Task
    from star_external.door import Door

log = logging.getLogger(__name__)

PORT: Final = 5799
"""The port if the mission names none."""

LOOPBACK: Final = "127.0.0.1"

TIME_OUT: Final = 60.0
"""How long the step may take if the mission does not say, s."""


def offer() -> Offer[Task]:
    """Return the verb; steps of one flight that name the same port share its door."""
    return Offer(
        name="external",
        before="air",
        summary="Fly to goals that another process sends through a socket.",
        make=partial(make, {}),
        check=check,
        options={
            "type": "object",
            "outside": {"holds": ["listen", "port"], "timeout": TIME_OUT},
            "properties": {
                "port": {
                    "type": "integer",
                    "minimum": 0,
                    "maximum": 65535,
                    "description": "TCP port to listen on; with 0 any that is free, which is told.",
                    "default": PORT,
                },
                "listen": {
                    "type": "string",
                    "description": "IPv4 address to listen on. The default is reached from this "
                    "computer only; from another one whoever reaches the port can steer.",
                    "default": LOOPBACK,
                    "examples": ["0.0.0.0"],  # noqa: S104 -- what an editor shows, not the default
                },
                "rate": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "description": "State lines a second, 1/s, to whole ticks; one a tick at most "
                    "and if not given.",
                    "examples": [10],
                },
                "silence": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "description": "For how long the other process may say nothing, s.",
                    "default": 2.0,
                },
                "then": {
                    "enum": ["hold", "fail"],
                    "description": "What to do when it has said nothing for so long: hold the "
                    "agents where they are until it says something, or fail the step.",
                    "default": "hold",
                },
                "patience": {
                    "type": "number",
                    "minimum": 0,
                    "description": "How long to wait until it has connected, and in lock-step for "
                    "each answer, s; in lock-step of the computer's time, else of the mission's.",
                    "default": 10.0,
                },
                "lockstep": {
                    "type": "boolean",
                    "description": "Whether a simulation waits for one line in answer to each "
                    "state line, so that a flight is the same every time; on hardware nothing "
                    "waits.",
                    "default": True,
                },
            },
            "examples": [{"port": PORT, "timeout": 60}],
        },
    )


def make(
    doors: dict[tuple[str, int], Door],
    scene: Scene,
    rows: tuple[int, ...],
    *,
    port: int = PORT,
    listen: str = LOOPBACK,
    **options: Any,
) -> Task:
    """Return the task, its port open: that it is taken shows before anybody takes off.

    Args:
        doors: Those that are open, by address.
        scene: The mission's scene.
        rows: Rows of the agents.
        port: To listen on.
        listen: To listen on.
        options: What `External` takes.

    Raises:
        PluginError: The port cannot be opened.
    """
    from star_external.door import Door
    from star_external.external import External, Manner

    door = doors.get((listen, port))
    if door is None or door.closed:
        door = doors[listen, port] = Door(listen, port)
        _tell(door, asked=port)
    return External(scene, rows, door, Manner(**options))


def _tell(door: Door, asked: int) -> None:
    """Say what the mission's author should know of a door: its port, and who can come in."""
    host, port = door.address
    if asked == 0:
        log.warning("external: listens on %s:%d", host, port)
    if not IPv4Address(host).is_loopback:
        log.warning("external: whoever reaches %s:%d can steer the agents", host, port)
