"""The verb ``external``: its options as JSON Schema, their checks, and the factory of its task."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator
from functools import partial
from ipaddress import AddressValueError, IPv4Address
from typing import TYPE_CHECKING, Any, Final

from star_core import PluginError, Problem, TaskSpec
from star_core.toolkit import Exclusive, number, positive
from star_external.protocol import DEFAULT_TIMEOUT, ticks_between

if TYPE_CHECKING:
    from star_core import Registry, Scene, Task
    from star_external.tcp_server import TcpServer

log = logging.getLogger(__name__)

PLANNER: Final = "external_planner"
"""The kind of plugins that set goals in this process."""

TOKEN: Final = "STAR_EXTERNAL_TOKEN"  # noqa: S105 -- a name
"""Environment variable: token of clients on other hosts; by default each flight has a new one."""

PROCESS_OPTIONS: Final[dict[str, dict[str, Any]]] = {
    "port": {
        "type": "integer",
        "minimum": 0,
        "maximum": 65535,
        "description": "TCP port to listen on; 0 selects a free port, which is logged.",
        "default": 5799,
    },
    "listen": {
        "type": "string",
        "description": "IPv4 address to listen on. The default accepts connections from this "
        "computer only; from others, a client has to send the flight's token first, which the log "
        "shows.",
        "default": "127.0.0.1",
        "examples": ["0.0.0.0"],  # noqa: S104 -- what an editor shows, not the default
    },
    "max_silence": positive("Maximum time without a line from the other process, s.", default=2.0),
    "on_silence": {
        "enum": ["hold", "fail"],
        "description": "What to do after that time: hold the agents' positions until a line "
        "arrives, or fail the step.",
        "default": "hold",
    },
    "response_timeout": number(
        "Time to wait for the connection, and in lock-step for each answer, s; "
        "wall time in lock-step, else mission time.",
        minimum=0,
        default=10.0,
    ),
    "lockstep": {
        "type": "boolean",
        "description": "Whether a simulation waits for one line in answer to each state line, so "
        "that flights are reproducible; on hardware it never waits.",
        "default": True,
    },
}  # which do not go with a planner


def spec(registry: Registry) -> TaskSpec:
    """Return the verb, with all installed planners in its schema.

    Steps of one flight with the same port share its server.
    """
    names = registry.names(PLANNER)
    installed = {"enum": list(names)} if names else {}  # an empty enum is not a valid schema
    return TaskSpec(
        name="external",
        before="air",
        summary="Fly to goals sent by another process through a socket, or by an installed "
        "planner.",
        make=partial(make, registry, {}),
        check=partial(check, registry),
        exclusive=Exclusive(options=("listen", "port"), unless="planner", timeout=DEFAULT_TIMEOUT),
        options={
            "type": "object",
            "properties": {
                "planner": {
                    "type": "string",
                    **installed,
                    "description": "Planner in this process that provides the goals: "
                    f"{', '.join(names) or 'none is installed'}. If not given, another process "
                    "provides them.",
                },
                "rate": positive(
                    "Rate of state lines, or of calls to the planner, 1/s, rounded "
                    "to whole ticks; at most, and if not given, once per tick.",
                    examples=[10],
                ),
                **PROCESS_OPTIONS,
            },
            "examples": [{"port": 5799, "timeout": 60}],
        },
    )


def check(
    registry: Registry,
    scene: Scene,
    _rows: tuple[int, ...],
    *,
    planner: str | None = None,
    rate: float | None = None,
    **options: Any,
) -> Iterator[Problem]:
    """Yield problems with these options."""
    changed = [key for key, rules in PROCESS_OPTIONS.items() if options[key] != rules["default"]]
    if planner is not None:
        try:
            registry.find(PLANNER, planner)
        except PluginError as error:
            yield Problem(("planner",), error.message, error.code)
        for key in changed:
            yield Problem(
                (key,),
                f"{key!r} applies to another process, but planner {planner!r} runs in this one; "
                "remove one of the two",
                "option-conflict",
            )
        return
    try:
        IPv4Address(options["listen"])
    except AddressValueError:
        yield Problem(
            ("listen",),
            f"{options['listen']!r} is not an IPv4 address, expected one like 127.0.0.1",
            "invalid-address",
        )
    apart = ticks_between(rate, scene.period) * scene.period
    silence = options["max_silence"]
    if silence <= apart:
        yield Problem(
            ("max_silence" if "max_silence" in changed else "rate",),
            f"a silence of {silence:g} s is not longer than the period of state lines, {apart:g} s",
            "out-of-range",
        )


def make(
    registry: Registry,
    servers: dict[tuple[str, int], TcpServer],
    scene: Scene,
    rows: tuple[int, ...],
    *,
    planner: str | None = None,
    rate: float | None = None,
    port: int,
    listen: str,
    **options: Any,
) -> Task:
    """Return the task, with its planner created or its port open, so that errors precede takeoff.

    Args:
        registry: Of the planners.
        servers: Open servers, by address.
        scene: The mission's scene.
        rows: Rows of the agents.
        planner: Name of the planner; None for another process.
        rate: Rate of state lines or of calls to the planner, 1/s; None for every tick.
        port: Port to listen on.
        listen: Address to listen on.
        options: Other options of `ProcessSource`.

    Raises:
        PluginError: The planner cannot be created, or the port cannot be opened.
    """
    from secrets import token_hex  # imports OpenSSL

    from star_external.external import External
    from star_external.planner_source import PlannerSource
    from star_external.process_source import ProcessSource
    from star_external.tcp_server import TcpServer

    if planner is not None:
        entry = registry.find(PLANNER, planner)
        origin = f"{planner!r} ({entry.source})"
        source = PlannerSource(scene, rows, entry.offer.make, origin, rate)
        return External(scene, rows, source)
    server = servers.get((listen, port))
    if server is None or server.closed:
        beyond = not IPv4Address(listen).is_loopback
        token = os.environ.get(TOKEN) or token_hex(8) if beyond else None
        server = servers[listen, port] = TcpServer(listen, port, token)
        _log_address(server, asked=port, token=token)
    return External(scene, rows, ProcessSource(scene, server, rate=rate, **options))


def _log_address(server: TcpServer, asked: int, token: str | None) -> None:
    """Log a port that was chosen automatically, and the token that other hosts need."""
    host, port = server.address
    if asked == 0:
        log.warning("external: listens on %s:%d", host, port)
    if token is not None:
        line = json.dumps({"token": token})
        log.warning("external: hosts that reach %s:%d must send %s first", host, port, line)
