"""``star fleet`` as its user sees it: serves a mission's drones until it is told to stop."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from errno import EADDRNOTAVAIL as NOWHERE
from pathlib import Path
from socket import gaierror
from types import FrameType
from typing import TYPE_CHECKING, Any

from star_core import InputError, Mission, PluginError, Registry, load
from star_sim.camera_options import CameraOptions

if TYPE_CHECKING:
    from star_sim.fleet.server import Fleet

LAST_PORT = 65535
CAMERAS = 5000
"""Port of the first camera if nobody says; an AI-deck's own is the same."""


def run(arguments: Sequence[str]) -> int:
    """Serve until interrupted and return the exit status, 0.

    Raises:
        InputError: The mission cannot be flown, or a port cannot be had.
    """
    options = parser().parse_args(arguments)
    assignments = [] if options.seed is None else [f"seed={options.seed}"]
    mission = load(Path(options.mission), Registry(), assignments)
    agents = mission.scene.agents
    carried = sum(agent.camera is not None for agent in agents)
    cameras = _first_camera(options, carried)
    _check_ports("--port", options.port, len(agents))
    _check_ports("--tcp", options.tcp, len(agents))
    _check_ports("--cameras", cameras, carried)
    _check_apart(options.tcp, len(agents), cameras, carried)
    from star_sim.fleet.server import Fleet

    with ExitStack() as opened:
        with _told_of("--port", options.port):
            fleet = Fleet(
                mission.scene,
                host=options.host,
                port=options.port,
                speed=options.speed,
                arms_itself=not options.brushless,
                **_of_simulator(mission, seen=cameras is not None),
            )
        opened.callback(fleet.close)
        more = _over_tcp(fleet, mission, options, cameras, opened)
        with _until_told(fleet):
            for row, (agent, uri) in enumerate(zip(agents, fleet.addresses, strict=True)):
                sys.stdout.write("  ".join([agent.name, uri, *more.get(row, ())]) + "\n")
            sys.stdout.flush()
            fleet.serve(options.duration)
    if fleet.slipped:
        sys.stderr.write(f"star: fleet: the clock stood still for {fleet.slipped:.1f} s in all\n")
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line, apart so that the docs and the tests can read it."""
    star = argparse.ArgumentParser(
        prog="star fleet",
        description="Serve a mission's drones as simulated Crazyflies: CRTP over UDP, a port each.",
        epilog="Noise, battery, endurance and camera are what the mission says of its transport "
        "`sim`.",
        allow_abbrev=False,
    )
    star.add_argument("mission", help="mission file (YAML)")
    star.add_argument(
        "--port",
        type=_port,
        default=19850,
        metavar="N",
        help="of the first drone; the others follow, 0 takes free ones: %(default)s",
    )
    star.add_argument(
        "--tcp",
        type=_port,
        metavar="N",
        help="serve the links as CPX over TCP too, from port N on, 0 takes free ones",
    )
    decks = star.add_mutually_exclusive_group()
    decks.add_argument(
        "--cameras",
        type=_port,
        metavar="N",
        help="stream the agents' cameras as AI-decks do from port N on, 0 takes free ones: "
        f"{CAMERAS}",
    )
    decks.add_argument("--no-cameras", action="store_true", help="stream no cameras")
    star.add_argument(
        "--jpeg", action="store_true", help="compress the cameras' images, as the deck can"
    )
    star.add_argument(
        "--brushless",
        action="store_true",
        help="drones with brushless motors, which have to be armed before they fly",
    )
    star.add_argument("--host", default="127.0.0.1", help="address to serve at: %(default)s")
    star.add_argument("--seed", help="seed of every random number (the mission's)")
    star.add_argument(
        "--speed", type=_positive, default=1.0, metavar="X", help="times real time: %(default)g"
    )
    star.add_argument(
        "--duration", type=_positive, metavar="S", help="simulated seconds to serve (for ever)"
    )
    return star


def _first_camera(options: argparse.Namespace, carried: int) -> int | None:
    """Return the port of the first camera, 0 for a free one; None if none is to be streamed.

    Raises:
        InputError: Something is asked of cameras of which there is none.
    """
    none = "" if carried else f"no agent of {options.mission} carries a 'camera'"
    if options.cameras is not None and none:
        raise InputError([f"--cameras {options.cameras}: {none}"])
    if options.jpeg and (none or options.no_cameras):
        raise InputError([f"--jpeg: there are no images to compress: {none or '--no-cameras'}"])
    if none or options.no_cameras:
        return None
    return CAMERAS if options.cameras is None else int(options.cameras)


def _check_ports(flag: str, first: int | None, count: int) -> None:
    """Refuse ports that there are not enough of.

    Raises:
        InputError: There are not.
    """
    if first and first + count - 1 > LAST_PORT:
        raise InputError([f"{flag} {first}: no {count} ports from there, {LAST_PORT} is the last"])


def _check_apart(links: int | None, agents: int, cameras: int | None, carried: int) -> None:
    """Refuse ports that links and cameras both want over TCP.

    Raises:
        InputError: There are some.
    """
    if links and cameras and links < cameras + carried and cameras < links + agents:
        raise InputError(
            [
                f"--tcp {links}: the links of {agents} agents would take ports of the cameras, "
                f"which begin at {cameras}; name others by --tcp N or --cameras N"
            ]
        )


@contextmanager
def _told_of(flag: str, port: int, instead: str = "") -> Iterator[None]:
    """Say by which flag the port was asked for that cannot be had.

    Raises:
        InputError: It cannot.
    """
    try:
        yield
    except PluginError as error:
        other = f"name another port by {flag} N{instead}"
        cause = error.__cause__
        if isinstance(cause, OSError) and (isinstance(cause, gaierror) or cause.errno == NOWHERE):
            other = "--host is to be an address of this computer"
        raise InputError([f"{flag} {port}: {error}; {other}"]) from error


def _over_tcp(
    fleet: Fleet,
    mission: Mission,
    options: argparse.Namespace,
    cameras: int | None,
    opened: ExitStack,
) -> dict[int, list[str]]:
    """Serve links and cameras over TCP if that is wanted, and return where, by row.

    Raises:
        InputError: A port cannot be had.
    """
    if options.tcp is None and cameras is None:
        return {}
    from star_sim.fleet.wifi import Wifi  # image compression is slow to import

    found: dict[int, list[str]] = {}
    scene, host = mission.scene, options.host
    if options.tcp is not None:
        with _told_of("--tcp", options.tcp):
            wifi = Wifi(fleet, scene, host, links=options.tcp, cameras=None)
        opened.callback(wifi.close)
        found = {row: [uri] for row, uri in wifi.links.items()}
    if cameras is not None:
        with _told_of("--cameras", cameras, ", or --no-cameras"):
            wifi = Wifi(fleet, scene, host, links=None, cameras=cameras, jpeg=options.jpeg)
        opened.callback(wifi.close)
        for row, address in wifi.cameras.items():
            found.setdefault(row, []).append(f"camera {address}")
    return found


def _of_simulator(mission: Mission, *, seen: bool) -> dict[str, Any]:
    """Return what the mission says of the simulator, if it flies with it.

    Args:
        mission: To be served.
        seen: Whether its cameras are to be streamed; they are then rendered, whatever it says.
    """
    part = mission.parts["transport"]
    options = part.options if part.use == "sim" else {}
    camera = CameraOptions.of({**options.get("camera", {}), "mode": "rendered"})
    return {
        "noise": options.get("noise", True),
        "battery": options.get("battery", 1.0),
        "endurance": options.get("endurance", 420.0),
        "camera": camera if seen else None,
    }


@contextmanager
def _until_told(fleet: Fleet) -> Iterator[None]:
    """Stop serving on Ctrl-C and its like."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        fleet.stop()

    caught = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, stop) for number in caught]
    try:
        yield
    finally:
        for number, handler in zip(caught, before, strict=True):
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


_port.__name__ = "port"  # as argparse calls them
_positive.__name__ = "positive number"
