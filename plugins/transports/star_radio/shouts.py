"""Which orders and corrections go to many drones with one packet, and which do not.

An order of the high-level commander (take off, land, stop, go to, start a trajectory) is for
everybody who hears it or for groups: eight bits, of which each drone has its own. One bit is for
all drones of the mission, so that no other hears them, and so an order that is the same for all,
or for all of one of the mission's groups, goes to all of them with one packet. A setpoint names no
groups in the firmware's protocol: velocities go to each drone over its own link.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from star_core import Corrections, PluginError, Scene
from star_radio import orders
from star_radio.address import RadioAddress
from star_radio.broadcast import Broadcaster
from star_radio.packed import PLACES, POSES, place, pose
from star_radio.packets import FARTHEST

GROUPS: Final = 8  # bits that the firmware has for them; the first is for all


class Shouts:
    """Broadcasts on the channels of a swarm's radios.

    Args:
        scene: The agents and their groups. Of the groups, the first seven count that have at
            least two radios, not all of them, and not the same as another.
        dongle: Number of the Crazyradio to broadcast with.

    Attributes:
        masks: Of each drone on the air, by its row: the groups that it is in, a bit each.

    Raises:
        PluginError: There is no such dongle, it cannot be used, or two drones share the last byte
            of their address.
    """

    def __init__(self, scene: Scene, dongle: int) -> None:
        found = ((row, RadioAddress.of(agent.uri or "")) for row, agent in enumerate(scene.agents))
        on = {row: address for row, address in found if address is not None}
        self._last = {row: int(address.address[-2:], 16) for row, address in on.items()}
        if len(set(self._last.values())) < len(self._last):
            raise PluginError(
                f"{scene.named(on)} share last bytes of addresses, by which broadcasts tell them "
                "apart; give each its own"
            )
        self._groups = _groups(scene.groups.values(), frozenset(on))
        self.masks: Mapping[int, int] = {
            row: sum(bit for bit, group in self._groups.items() if row in group) for row in on
        }
        self._radio = Broadcaster(dongle, list(on.values()))

    def disband(self) -> None:
        """Broadcast that nobody is in a group, and wait until that is said.

        A drone that hears broadcasts and cannot be connected to may be in a group from before, and
        would obey an order that is not for it.
        """
        if self._radio.order(orders.set_groups(0)):
            self._radio.wait()

    def order(self, packets: Mapping[int, bytes]) -> dict[int, bytes]:
        """Broadcast an order to the groups for whom it is the same; all are one.

        Nobody hears an order of another's: what goes to a group is for every radio of it, also for
        one that is absent. Nothing is broadcast once the dongle has failed.

        Args:
            packets: For everybody, by the row of the drone that each is for.

        Returns:
            What was broadcast, by the rows of the drones that it is for: it differs by its groups.
        """
        alike: dict[bytes, set[int]] = {}
        for row in sorted(self._last.keys() & packets.keys()):
            alike.setdefault(packets[row], set()).add(row)
        said: dict[int, bytes] = {}
        for packet, rows in alike.items():
            bits = [bit for bit, group in self._groups.items() if group <= rows]
            if not bits:
                continue
            # named together: who is in two of them hears it once
            reached = frozenset[int]().union(*(self._groups[bit] for bit in bits))
            shout = orders.only_for(sum(bits), packet)
            if self._radio.order(shout, reached):
                said |= dict.fromkeys(reached, shout)
        return said

    def void(self, rows: Iterable[int]) -> None:
        """Broadcast orders to any of these drones no more: something newer is for them."""
        self._radio.void(frozenset(rows))

    def correct(self, corrections: Corrections) -> Sequence[int]:
        """Broadcast where drones on the air are; return the rows of those who are told that way.

        A packet holds two poses, or four positions; of one too far for its millimetres, none.
        """
        if self._radio.broken:
            return ()
        near = (abs(corrections.position) <= FARTHEST).all(axis=1)
        told = []
        for i in np.flatnonzero(near).tolist():
            row = int(corrections.agent[i])
            if (last := self._last.get(row)) is None:
                continue
            position = corrections.position[i].tolist()
            if np.isfinite(corrections.attitude_deviation[i]):
                part = pose(last, position, corrections.attitude[i].tolist())
                self._radio.show(POSES, last, part)
            else:
                self._radio.show(PLACES, last, place(last, position))
            told.append(row)
        return told

    def close(self) -> None:
        """Release the dongle."""
        self._radio.close()


def _groups(
    groups: Iterable[Sequence[int]], radios: frozenset[int]
) -> Mapping[int, frozenset[int]]:
    """Return the radios that each bit is for: all, and the groups that one is worth while for."""
    distinct = dict.fromkeys(radios.intersection(rows) for rows in groups)
    worth = [rows for rows in distinct if 1 < len(rows) < len(radios)]
    return {1 << i: rows for i, rows in enumerate([radios, *worth][:GROUPS])}
