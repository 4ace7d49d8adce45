"""Which orders and corrections go to many drones with one packet, and which do not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from star_core import Array, Corrections, PluginError, Scene
from star_radio.address import RadioAddress
from star_radio.broadcast import Broadcaster, pose_packets


class Shouts:
    """Broadcasts on the channels of a swarm's radios.

    Args:
        scene: The agents.
        dongle: Number of the Crazyradio to broadcast with.

    Raises:
        PluginError: There is no such dongle, or two drones share the last byte of their address.
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
        self._radio = Broadcaster(dongle, list(on.values()))

    def order(self, packets: Mapping[int, bytes]) -> Sequence[int]:
        """Broadcast an order if it is the same for every radio; return the rows that it reached.

        Args:
            packets: By the row of the drone that it is for.
        """
        meant = {packets[row] for row in self._last if row in packets}
        if len(meant) != 1 or any(row not in packets for row in self._last):
            return ()
        self._radio.post(meant.pop())
        return tuple(self._last)

    def correct(self, corrections: Corrections) -> Sequence[int]:
        """Broadcast the poses of the drones that are on the air; return their rows."""
        rows = [i for i, row in enumerate(corrections.agent.tolist()) if row in self._last]
        last = [self._last[int(corrections.agent[i])] for i in rows]
        position: Array = corrections.position[rows]
        attitude: Array = corrections.attitude[rows]
        for packet in pose_packets(last, position.tolist(), attitude.tolist()):
            self._radio.post(packet)
        return tuple(self._last)

    def close(self) -> None:
        """Release the dongle."""
        self._radio.close()
