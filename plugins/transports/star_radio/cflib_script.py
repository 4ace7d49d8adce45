"""Run a script for cflib with a fleet's drones in place of radios: ``-m star_radio.cflib_script``.

``star fleet MISSION -- python SCRIPT.py`` starts it. Before the script runs, a link driver is
registered with cflib that maps ``radio://`` and ``usb://`` addresses to the drones that `FLEET`
lists; cflib's own drivers serve all other addresses. An address belongs to the drone whose ``uri``
in the mission it is, else to the one with its address on the radio, else to the next drone that no
other address of the script has.
"""

from __future__ import annotations

import json
import os
import runpy
import sys
from pathlib import Path
from threading import Lock
from typing import Any, Final, NamedTuple

FLEET: Final = "STAR_FLEET"
"""Environment variable: a JSON list of the drones, each ``[name, uri, radio address, UDP URI]``."""
SCHEMES: Final = ("radio://", "usb://")
DEFAULT_ADDRESS: Final = "E7E7E7E7E7"  # of a drone whose radio URI names none


class Drone(NamedTuple):
    """A drone of the fleet.

    Attributes:
        name: In the mission.
        uri: In the mission; empty if it has none.
        address: On the radio, ten hex digits.
        link: Where the fleet serves it.
    """

    name: str
    uri: str
    address: str
    link: str


class Drones:
    """The drones of a fleet, and which radio address each of them answers to."""

    def __init__(self, drones: list[Drone]) -> None:
        self._drones = drones
        self._taken: dict[str, Drone] = {}
        self._lock = Lock()  # links are opened by a thread each

    def drone(self, uri: str) -> Drone:
        """Return the drone of a radio or USB address, always the same one.

        Raises:
            ConnectionError: All drones answer to other addresses.
        """
        uri = uri.partition("?")[0]
        with self._lock:
            drone = self._taken.get(uri)
            if drone is None:
                drone = self._taken[uri] = self._free(uri)
                sys.stderr.write(f"star: fleet: {uri} is {drone.name}, {drone.link}\n")
            return drone

    def _free(self, uri: str) -> Drone:
        free = [drone for drone in self._drones if drone not in self._taken.values()]
        if not free:
            text = f"{uri}: all {len(self._drones)} drones of the fleet have other addresses"
            raise ConnectionError(text)
        named = [drone for drone in free if drone.uri.partition("?")[0] == uri]
        same = [drone for drone in free if drone.address == address(uri)]
        return (named or same or free)[0]

    def at(self, radio_address: str) -> list[str]:
        """Return radio URIs of the drones with an address on the radio."""
        return [f"radio://0/80/2M/{d.address}" for d in self._drones if d.address == radio_address]


def address(uri: str) -> str:
    """Return the address on the radio of a URI, ten hex digits; '' for one by USB.

    >>> address("radio://0/80/2M/E7E7E7E701"), address("radio://0/80/2M")
    ('E7E7E7E701', 'E7E7E7E7E7')
    """
    if not uri.startswith("radio://"):
        return ""
    fields = uri.partition("?")[0].removeprefix("radio://").split("/")
    return fields[3].upper().zfill(10) if len(fields) > 3 else DEFAULT_ADDRESS  # noqa: PLR2004


def driver(drones: Drones) -> type[Any]:
    """Return a link driver of cflib's for the radio addresses of a fleet."""
    from cflib.crtp.exceptions import WrongUriType
    from cflib.crtp.udpdriver import UdpDriver

    class FleetDriver(UdpDriver):  # type: ignore[misc]  # cflib has no types
        """Links to the drones of a fleet by their addresses on the radio."""

        def connect(self, uri: str, statistics: Any, failed: Any) -> None:
            if not uri.startswith(SCHEMES):
                raise WrongUriType(uri)
            super().connect(drones.drone(uri).link, statistics, failed)
            self.uri = uri

        def scan_interface(self, address: int | None = None) -> list[list[str]]:
            digits = DEFAULT_ADDRESS if address is None else f"{address:010X}"
            return [[uri, ""] for uri in drones.at(digits)]

        def get_name(self) -> str:
            return "star fleet"

    return FleetDriver


def main() -> None:
    """Run the script that the arguments name, as Python would."""
    from cflib import crtp

    drones = [Drone(*fields) for fields in json.loads(os.environ[FLEET])]
    crtp.CLASSES.insert(0, driver(Drones(drones)))  # before the radio's, which the script adds
    del sys.argv[0]
    script = sys.argv[0]
    sys.path[0] = str(Path(script).resolve().parent)
    runpy.run_path(script, run_name="__main__")


if __name__ == "__main__":
    main()
