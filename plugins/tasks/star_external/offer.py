"""What ``external`` takes, as JSON Schema, and how its task is made."""

from __future__ import annotations

import logging
from functools import partial
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Any, Final

from star_core import Offer
from star_external.checks import check
from star_external.choice import GROUP, chosen, names

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
    """Return the verb, with every planner that is installed.

    Steps of one flight that name the same port share its door.
    """
    installed = {"enum": list(names())} if names() else {}  # an enum of nothing is no schema
    return Offer(
        name="external",
        before="air",
        summary="Fly to goals that another process sends through a socket, or that an installed "
        "planner gives.",
        make=partial(make, {}),
        check=check,
        options={
            "type": "object",
            "outside": {
                "holds": ["listen", "port"],
                "unless": "planner",
                "timeout": TIME_OUT,
            },
            "properties": {
                "planner": {
                    "type": "string",
                    **installed,
                    "description": "Planner that gives the goals, in this process and in place of "
                    f"another one; entry points of {GROUP}: {', '.join(names()) or 'none'}; if not "
                    "given another process gives them.",
                },
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
                    "description": "State lines a second, or questions to the planner, 1/s, to "
                    "whole ticks; one a tick at most and if not given.",
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
    planner: str | None = None,
    port: int = PORT,
    listen: str = LOOPBACK,
    **options: Any,
) -> Task:
    """Return the task, its planner made or its port open: what is wrong shows before a take-off.

    Args:
        doors: Those that are open, by address.
        scene: The mission's scene.
        rows: Rows of the agents.
        planner: Gives the goals; None for another process.
        port: To listen on.
        listen: To listen on.
        options: What `Manner` takes; beside a planner its `rate` only.

    Raises:
        PluginError: The planner cannot be made, or the port cannot be opened.
    """
    from star_external.external import External

    if planner is not None:
        from star_external.consultation import Consultation

        return External(scene, rows, Consultation(scene, rows, chosen(planner), **options))

    from star_external.conversation import Conversation, Manner
    from star_external.door import Door

    door = doors.get((listen, port))
    if door is None or door.closed:
        door = doors[listen, port] = Door(listen, port)
        _tell(door, asked=port)
    return External(scene, rows, Conversation(scene, door, Manner(**options)))


def _tell(door: Door, asked: int) -> None:
    """Say what the mission's author should know of a door: its port, and who can come in."""
    host, port = door.address
    if asked == 0:
        log.warning("external: listens on %s:%d", host, port)
    if not IPv4Address(host).is_loopback:
        log.warning("external: whoever reaches %s:%d can steer the agents", host, port)
