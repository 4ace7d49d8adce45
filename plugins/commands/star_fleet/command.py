"""The command ``star fleet``: serves a mission's drones until it is interrupted."""

from __future__ import annotations

import argparse
import math
import signal
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from errno import EADDRNOTAVAIL as NOWHERE
from pathlib import Path
from socket import gaierror
from typing import TYPE_CHECKING, Any

from star_core import InputError, Mission, PluginError, Registry, load
from star_core.commands import add_set_option
from star_core.toolkit import fill_defaults
from star_fleet.conditions import Condition, read_conditions
from star_fleet.decks import OPTIONAL
from star_sim import OPTIONS, simulator_arguments

if TYPE_CHECKING:
    from star_fleet.server import Fleet

LAST_PORT = 65535
MOTION_CAPTURE = {"std": 0.002, "rate": 100.0, "latency": 0.02, "yaw_std_deg": 0.5}
CAMERAS = 5000
"""Default port of the first camera, as on an AI-deck."""


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Serve until interrupted, or until the script ends; return its exit status, or 0.

    Raises:
        InputError: The mission cannot be flown, or a port is not available.
    """
    assignments = options.set + ([] if options.seed is None else [f"seed={options.seed}"])
    mission = load(Path(options.mission), registry, assignments)
    scene, host = mission.scene, options.host
    agents = scene.agents
    carried = sum(agent.camera is not None for agent in agents)
    cameras = _first_camera(options, carried)
    _check_ports(options, len(agents), cameras, carried)
    from star_fleet.server import Fleet

    conditions = read_conditions(options.condition, scene)
    more: dict[int, list[str]] = {}
    with ExitStack() as opened:
        with _port_errors("--port", options.port):
            fleet = Fleet(
                scene,
                host=host,
                port=options.port,
                speed=options.speed,
                arms_itself=not options.brushless,
                link_timeout=options.link_timeout or math.inf,
                conditions=conditions,
                decks=[OPTIONAL[name] for name in dict.fromkeys(options.deck)],
                **_of_simulator(
                    mission, render=cameras is not None, capture=options.mocap is not None
                ),
            )
        opened.callback(fleet.close)
        if options.faults:
            injects = registry.find("run_option", "faults").offer
            fleet.inject(injects.make(mission, registry, options.faults).faults)
        if options.tcp is not None or cameras is not None:
            from star_fleet.aideck import Wifi  # image compression is slow to import
        if options.tcp is not None:
            with _port_errors("--tcp", options.tcp):
                wifi = Wifi(fleet, scene, host, links=options.tcp, cameras=None)
            opened.callback(wifi.close)
            more = {row: [uri] for row, uri in wifi.links.items()}
        if cameras is not None:
            with _port_errors("--cameras", cameras, ", or --no-cameras"):
                wifi = Wifi(fleet, scene, host, links=None, cameras=cameras, jpeg=options.jpeg)
            opened.callback(wifi.close)
            for row, address in wifi.cameras.items():
                more.setdefault(row, []).append(f"camera {address}")
        if options.mocap is not None:
            from star_fleet.natnet import NatNetServer

            with _port_errors("--mocap", options.mocap):
                capture = NatNetServer(scene.names, host, options.mocap)
            opened.callback(capture.close)
            fleet.capture(capture.serve)
            sys.stdout.write(f"motion capture: natnet at {host}, command_port {capture.port}\n")
        lines = [
            "  ".join([agent.name, uri, *more.get(row, ())]) + "\n"
            for row, (agent, uri) in enumerate(zip(agents, fleet.addresses, strict=True))
        ]
        status = _served(fleet, mission, options, "".join(lines))
    if fleet.slipped:
        sys.stderr.write(f"star: fleet: the clock was stopped for {fleet.slipped:.1f} s in all\n")
    return status


def _served(fleet: Fleet, mission: Mission, options: argparse.Namespace, listing: str) -> int:
    """Print the addresses, and serve until interrupted, or until the script ends.

    Returns:
        The exit status of the script, or 0.
    """
    if not options.script:
        with _until_interrupted(fleet):
            sys.stdout.write(listing)
            sys.stdout.flush()
            fleet.serve(options.duration)
        return 0
    from star_fleet.client_script import client

    sys.stderr.write(listing)
    with client(options.script, fleet, mission) as exit_status:
        fleet.serve(options.duration)
        return exit_status()


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Serve a mission's drones as simulated Crazyflies: CRTP over UDP, a port each."
    )
    line.epilog = "The options of the mission's transport `sim` apply, except `speed` and `radio`."
    line.add_argument("mission", help="mission file (YAML)")
    line.add_argument(
        "script",
        nargs="*",
        metavar="-- python SCRIPT.py",
        help="run a script for cflib when the ports are open, with its radio:// addresses mapped "
        "to the drones, or `star COMMAND ...` with transport radio and the drones' addresses; exit "
        "with its status when it ends",
    )
    line.add_argument(
        "--port",
        type=_port,
        default=19850,
        metavar="N",
        help="UDP port of the first drone, the others follow; 0 selects free ports: %(default)s",
    )
    line.add_argument(
        "--tcp",
        type=_port,
        metavar="N",
        help="also serve the links as CPX over TCP, from port N on; 0 selects free ports",
    )
    line.add_argument(
        "--mocap",
        type=_port,
        metavar="N",
        help="also serve the positions of the mission's simulated `positioning` by NatNet 3.1 "
        "(unicast), as OptiTrack's Motive does, with command port N; 0 selects a free one",
    )
    decks = line.add_mutually_exclusive_group()
    decks.add_argument(
        "--cameras",
        type=_port,
        metavar="N",
        help="stream the agents' cameras like AI-decks, from port N on; 0 selects free ports: "
        f"{CAMERAS}",
    )
    decks.add_argument("--no-cameras", action="store_true", help="do not stream cameras")
    line.add_argument("--jpeg", action="store_true", help="compress the cameras' images as JPEG")
    line.add_argument(
        "--brushless",
        action="store_true",
        help="drones with brushless motors, which must be armed before flight",
    )
    line.add_argument("--host", default="127.0.0.1", help="address to serve at: %(default)s")
    line.add_argument(
        "--faults", metavar="FILE", help="inject the faults of FILE: of drones, links and firmware"
    )
    line.add_argument(
        "--condition",
        action="append",
        default=[],
        metavar="AGENT=CONDITION",
        help="condition of a drone before the flight, for `star preflight`; may be repeated: "
        f"{', '.join(Condition)}",
    )
    line.add_argument(
        "--deck",
        action="append",
        default=[],
        choices=tuple(OPTIONAL),
        help="deck that all drones carry beside those of the mission; may be repeated",
    )
    line.add_argument(
        "--link-timeout",
        type=_not_negative,
        default=1.0,
        metavar="S",
        help="seconds without a packet after which a drone deletes its log blocks, as the firmware "
        "does by radio; 0 for none, as in CrazySim: %(default)g",
    )
    add_set_option(line)
    line.add_argument("--seed", help="random seed (default: the mission's)")
    line.add_argument(
        "--speed",
        type=_positive,
        default=1.0,
        metavar="X",
        help="simulation speed factor: %(default)g",
    )
    line.add_argument(
        "--duration",
        type=_positive,
        metavar="S",
        help="simulated seconds to serve (default: unlimited)",
    )


def _first_camera(options: argparse.Namespace, carried: int) -> int | None:
    """Return the port of the first camera, 0 for a free one; None if no camera is streamed."""
    missing = "" if carried else f"no agent of {options.mission} carries a 'camera'"
    if options.cameras is not None and missing:
        raise InputError(f"--cameras {options.cameras}: {missing}", "missing-camera")
    if options.jpeg and (missing or options.no_cameras):
        why = missing or "--no-cameras"
        raise InputError(f"--jpeg: there are no images to compress: {why}", "option-conflict")
    if missing or options.no_cameras:
        return None
    return CAMERAS if options.cameras is None else int(options.cameras)


def _check_ports(
    options: argparse.Namespace, agents: int, cameras: int | None, carried: int
) -> None:
    """Check that there are enough ports from each first one on, and that they do not overlap."""
    links = options.tcp
    for flag, first, count in (
        ("--port", options.port, agents),
        ("--tcp", links, agents),
        ("--cameras", cameras, carried),
    ):
        if first and first + count - 1 > LAST_PORT:
            raise InputError(
                f"{flag} {first}: no {count} ports from there, {LAST_PORT} is the last",
                "out-of-range",
            )
    if links and cameras and links < cameras + carried and cameras < links + agents:
        raise InputError(
            f"--tcp {links}: the links of {agents} agents would take ports of the cameras, which "
            f"begin at {cameras}; name others by --tcp N or --cameras N",
            "option-conflict",
        )


@contextmanager
def _port_errors(flag: str, port: int, instead: str = "") -> Iterator[None]:
    """Name the flag of a port that is not available."""
    try:
        yield
    except PluginError as error:
        other, code = f"name another port by {flag} N{instead}", error.code
        cause = error.__cause__
        if isinstance(cause, OSError) and (isinstance(cause, gaierror) or cause.errno == NOWHERE):
            other, code = "--host must be an address of this computer", "invalid-address"
        raise InputError(f"{flag} {port}: {error.message}; {other}", code) from error


def _of_simulator(mission: Mission, *, render: bool, capture: bool) -> dict[str, Any]:
    """Return the simulator's arguments for the mission, the defaults for another transport.

    Args:
        mission: The mission.
        render: Whether cameras are streamed; they are then rendered, whatever the mission's mode.
        capture: Whether there is motion capture: `MOTION_CAPTURE`, if the mission has no other.
    """
    choice = mission.plugins["transport"]
    chosen = choice.options if choice.use == "sim" else {}
    if capture:
        chosen = {"positioning": MOTION_CAPTURE, **chosen}
    options = fill_defaults(chosen, OPTIONS)
    options["camera"] = {**options.get("camera", {}), "mode": "rendered" if render else "off"}
    del options["speed"]  # the fleet's own
    return simulator_arguments(**options)


@contextmanager
def _until_interrupted(fleet: Fleet) -> Iterator[None]:
    """Stop serving on SIGINT (Ctrl-C) or SIGTERM."""
    before = {
        number: signal.signal(number, lambda *_signal: fleet.stop())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _port(text: str) -> int:
    number = int(text)
    if not 0 <= number <= LAST_PORT:
        raise ValueError(text)
    return number


def _positive(text: str) -> float:
    number = float(text)
    if not 0 < number < float("inf"):
        raise ValueError(text)
    return number


def _not_negative(text: str) -> float:
    return 0.0 if float(text) == 0 else _positive(text)


_port.__name__ = "port"  # as argparse calls them
_positive.__name__ = "positive number"
_not_negative.__name__ = "non-negative number"
