"""Command ``star fleet``: simulated Crazyflies that speak the firmware's CRTP over UDP.

``star fleet mission.yaml`` serves the drones of a mission to any client; `star_fleet.server.Fleet`
does so in a test. `star_fleet.vehicle` implements the answers of a vehicle, without sockets.
Names, types, formats and times are those of the Crazyflie firmware, protocol version 12.
"""

from __future__ import annotations

from collections.abc import Iterable

from star_core import deferred, hookimpl
from star_core.commands import CommandSpec


@hookimpl
def star_commands() -> Iterable[CommandSpec]:
    yield CommandSpec(
        name="fleet",
        summary="Serve a mission's drones as simulated Crazyflies over UDP, for any client.",
        configure=deferred("star_fleet.command:configure"),
        run=deferred("star_fleet.command:run"),
        group="Hardware",
    )
