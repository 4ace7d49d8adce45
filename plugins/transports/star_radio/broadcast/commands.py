"""Selection of the commands and corrections that one broadcast can send to many drones.

A command to the high-level commander (take off, land, stop, go to, start a trajectory) addresses
either all drones that receive it or groups: a mask of eight bits, matched against each drone's own
mask. One bit stands for all drones of the mission, so that other drones ignore the command. Thus a
command that is the same for all drones, or for all of one of the mission's groups, takes a single
packet. Setpoints have no group mask in the firmware's protocol: velocities go to each drone over
its own link.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from star_core import Corrections, PluginError, Scene
from star_radio import orders
from star_radio.address import RadioAddress
from star_radio.broadcast.dongle import Broadcaster
from star_radio.connection.packets import MAX_COORDINATE
from star_radio.orders import POSES, POSITIONS, pose_entry

MAX_GROUPS: Final = 8  # bits of the firmware's mask; the first is for all drones of the mission


class BroadcastCommands:
    """Broadcasts on the channels of a swarm's radios.

    Args:
        scene: The agents and their groups. Of the groups, the first seven are used that contain
            at least two radio links, not all of them, and differ from each other.
        dongle: Number of the Crazyradio for broadcasts.

    Attributes:
        masks: Group mask of each drone with a radio link, by its row.
    """

    def __init__(self, scene: Scene, dongle: int) -> None:
        found = ((row, RadioAddress.of(agent.uri or "")) for row, agent in enumerate(scene.agents))
        on = {row: address for row, address in found if address is not None}
        self._last = {row: int(address.address[-2:], 16) for row, address in on.items()}
        if len(set(self._last.values())) < len(self._last):
            raise PluginError(
                f"{scene.named(on)} share the last byte of an address, which identifies drones in "
                "broadcasts; make it unique",
                "duplicate-address",
            )
        self._groups = _groups(scene.groups.values(), frozenset(on))
        self.masks: Mapping[int, int] = {
            row: sum(bit for bit, group in self._groups.items() if row in group) for row in on
        }
        self._radio = Broadcaster(dongle, list(on.values()))

    def clear_groups(self) -> None:
        """Broadcast that all drones leave their groups, and wait until that is sent.

        A drone that receives broadcasts but cannot be connected to may still be in a group of an
        earlier flight, and would execute commands of this one.
        """
        if self._radio.order(orders.set_groups(0)):
            self._radio.wait()

    def order(self, packets: Mapping[int, bytes]) -> dict[int, bytes]:
        """Broadcast a command to the groups whose members all receive the same packet.

        A group is addressed only if the packet is for each of its radio links, absent drones
        included. Nothing is broadcast once the dongle has failed.

        Args:
            packets: Packets addressed to all groups, by the row of the drone.

        Returns:
            The broadcast packets, by the rows of the drones; they differ by their group masks.
        """
        alike: dict[bytes, set[int]] = {}
        for row in sorted(self._last.keys() & packets.keys()):
            alike.setdefault(packets[row], set()).add(row)
        sent: dict[int, bytes] = {}
        for packet, rows in alike.items():
            bits = [bit for bit, group in self._groups.items() if group <= rows]
            if not bits:
                continue
            # one mask for all groups: a drone in two of them receives the packet once
            reached = frozenset[int]().union(*(self._groups[bit] for bit in bits))
            addressed = orders.only_for(sum(bits), packet)
            if self._radio.order(addressed, reached):
                sent |= dict.fromkeys(reached, addressed)
        return sent

    def void(self, rows: Iterable[int]) -> None:
        """Stop broadcasting commands to these drones: a newer one replaces them."""
        self._radio.void(frozenset(rows))

    def correct(self, corrections: Corrections) -> Sequence[int]:
        """Broadcast corrections to drones with radio links; return their rows.

        A packet holds two poses or four positions. Positions beyond ±`MAX_COORDINATE` do not fit
        its millimetres and are sent over the link.
        """
        if self._radio.broken:
            return ()
        near = (abs(corrections.position) <= MAX_COORDINATE).all(axis=1)
        sent = []
        for i in np.flatnonzero(near).tolist():
            row = int(corrections.agent[i])
            if (last := self._last.get(row)) is None:
                continue
            at = corrections.position[i].tolist()
            if np.isfinite(corrections.attitude_deviation[i]):
                entry = pose_entry(last, at, corrections.attitude[i].tolist())
                self._radio.show(POSES, last, entry)
            else:
                self._radio.show(POSITIONS, last, pose_entry(last, at))
            sent.append(row)
        return sent

    def close(self) -> None:
        """Release the dongle."""
        self._radio.close()


def _groups(
    groups: Iterable[Sequence[int]], radios: frozenset[int]
) -> Mapping[int, frozenset[int]]:
    """Return the rows of each bit: all radio links, and the groups that benefit from a bit."""
    distinct = dict.fromkeys(radios.intersection(rows) for rows in groups)
    useful = [rows for rows in distinct if 1 < len(rows) < len(radios)]
    return {1 << i: rows for i, rows in enumerate([radios, *useful][:MAX_GROUPS])}
