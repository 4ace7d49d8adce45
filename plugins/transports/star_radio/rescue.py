"""Lands drones through new links, without their reports, after the guardian is lost."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final, NamedTuple

from star_core import PluginError
from star_radio import orders
from star_radio.connection.link import Link
from star_radio.connection.udp_links import UdpLinks
from star_radio.vehicle import landing

log = logging.getLogger(__name__)

OPEN_TIMEOUT: Final = 1.0  # s
REPEAT_TIME: Final = 1.0  # s, for which the commands are repeated
REPEAT_PERIOD: Final = 0.1  # s
ORDERS_FIRST: Final = 3  # landings sent before a notification, one of which arrives


class Airborne(NamedTuple):
    """A drone in the air: its name, the address of its link and its last reported height, m."""

    name: str
    uri: str
    height: float


def land(drones: Sequence[Airborne], udp: str) -> None:
    """Command drones to land in place; log those whose links cannot be opened.

    A landing that is repeated while the drone executes it changes nothing. The notification that
    setpoints stop follows `ORDERS_FIRST` of them: without a plan to fly it would stop the motors. A
    drone that rebooted is in no group and ignores the landings.
    """
    udp_links = UdpLinks() if udp == "sockets" else None

    def opened(drone: Airborne) -> tuple[Airborne, Link | None]:
        link = Link(drone.uri, drone.name, udp_links)
        try:
            link.open(OPEN_TIMEOUT)
        except PluginError as error:
            log.warning("radio: %s cannot be landed: %s", drone.name, error)
            return drone, None
        return drone, link

    with ThreadPoolExecutor(len(drones)) as pool:
        links = list(pool.map(opened, drones))
        for sent in range(round(REPEAT_TIME / REPEAT_PERIOD)):
            for drone, link in links:
                if link is not None:
                    link.post(orders.only_for(orders.MISSION, landing(drone.height)))
                    if sent + 1 >= ORDERS_FIRST:
                        link.post(orders.no_more_setpoints())
            time.sleep(REPEAT_PERIOD)
        list(pool.map(Link.close, [link for _drone, link in links if link is not None]))
    if udp_links is not None:
        udp_links.close()
