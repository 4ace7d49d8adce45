"""Specification of the verb ``external``: its options as JSON Schema, and its factory."""

from __future__ import annotations

import logging
from functools import partial
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Any, Final

from star_core import Exclusive, TaskSpec
from star_external.checks import PROCESS_DEFAULTS, check
from star_external.planner_registry import GROUP, chosen, names

if TYPE_CHECKING:
    from star_core import Scene, Task
    from star_external.tcp_server import TcpServer

log = logging.getLogger(__name__)

DEFAULT_TIMEOUT: Final = 60.0
"""Default timeout of the step, s."""


def offer() -> TaskSpec:
    """Return the verb, with all installed planners in its schema.

    Steps of one flight with the same port share its server.
    """
    installed = {"enum": list(names())} if names() else {}  # an empty enum is not a valid schema
    return TaskSpec(
        name="external",
        before="air",
        summary="Fly to goals sent by another process through a socket, or by an installed "
        "planner.",
        make=partial(make, {}),
        check=check,
        exclusive=Exclusive(options=("listen", "port"), unless="planner", timeout=DEFAULT_TIMEOUT),
        options={
            "type": "object",
            "properties": {
                "planner": {
                    "type": "string",
                    **installed,
                    "description": "Planner in this process that provides the goals; entry points "
                    f"of {GROUP}: {', '.join(names()) or 'none'}. If not given, another "
                    "process provides them.",
                },
                "port": {
                    "type": "integer",
                    "minimum": 0,
                    "maximum": 65535,
                    "description": "TCP port to listen on; 0 selects a free port, which is logged.",
                    "default": PROCESS_DEFAULTS["port"],
                },
                "listen": {
                    "type": "string",
                    "description": "IPv4 address to listen on. The default accepts connections "
                    "from this computer only; otherwise any host that reaches the port can control "
                    "the agents.",
                    "default": PROCESS_DEFAULTS["listen"],
                    "examples": ["0.0.0.0"],  # noqa: S104 -- what an editor shows, not the default
                },
                "rate": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "description": "Rate of state lines, or of calls to the planner, 1/s, rounded "
                    "to whole ticks; at most, and if not given, once per tick.",
                    "examples": [10],
                },
                "silence": {
                    "type": "number",
                    "exclusiveMinimum": 0,
                    "description": "Maximum time without a line from the other process, s.",
                    "default": PROCESS_DEFAULTS["silence"],
                },
                "then": {
                    "enum": ["hold", "fail"],
                    "description": "What to do after that time: hold the agents' positions until "
                    "a line arrives, or fail the step.",
                    "default": PROCESS_DEFAULTS["then"],
                },
                "response_timeout": {
                    "type": "number",
                    "minimum": 0,
                    "description": "Time to wait for the connection, and in lock-step for each "
                    "answer, s; wall time in lock-step, else mission time.",
                    "default": PROCESS_DEFAULTS["response_timeout"],
                },
                "lockstep": {
                    "type": "boolean",
                    "description": "Whether a simulation waits for one line in answer to each "
                    "state line, so that flights are reproducible; on hardware it never waits.",
                    "default": PROCESS_DEFAULTS["lockstep"],
                },
            },
            "examples": [{"port": PROCESS_DEFAULTS["port"], "timeout": 60}],
        },
    )


def make(
    servers: dict[tuple[str, int], TcpServer],
    scene: Scene,
    rows: tuple[int, ...],
    *,
    planner: str | None = None,
    port: int,
    listen: str,
    **options: Any,
) -> Task:
    """Return the task, with its planner created or its port open, so that errors precede takeoff.

    Args:
        servers: Open servers, by address.
        scene: The mission's scene.
        rows: Rows of the agents.
        planner: Name of the planner; None for another process.
        port: Port to listen on.
        listen: Address to listen on.
        options: Fields of `ConnectionOptions`; with a planner only `rate`.

    Raises:
        PluginError: The planner cannot be created, or the port cannot be opened.
    """
    from star_external.external import External

    if planner is not None:
        from star_external.planner_source import PlannerSource

        rate: float | None = options.get("rate")
        return External(scene, rows, PlannerSource(scene, rows, chosen(planner), rate))

    from star_external.process_source import ConnectionOptions, ProcessSource
    from star_external.tcp_server import TcpServer

    server = servers.get((listen, port))
    if server is None or server.closed:
        server = servers[listen, port] = TcpServer(listen, port)
        _log_address(server, asked=port)
    return External(scene, rows, ProcessSource(scene, server, ConnectionOptions(**options)))


def _log_address(server: TcpServer, asked: int) -> None:
    """Log a port that was chosen automatically, and warn if other hosts can connect."""
    host, port = server.address
    if asked == 0:
        log.warning("external: listens on %s:%d", host, port)
    if not IPv4Address(host).is_loopback:
        log.warning("external: any host that reaches %s:%d can control the agents", host, port)
