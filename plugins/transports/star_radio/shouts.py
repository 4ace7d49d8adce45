"""Which orders and corrections go to many drones with one packet, and which do not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from star_core import Corrections, PluginError, Scene
from star_radio.address import RadioAddress
from star_radio.broadcast import Broadcaster, pose


class Shouts:
    """Broadcasts on the channels of a swarm's radios.

    Args:
        scene: The agents.
        dongle: Number of the Crazyradio to broadcast with.

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
        self._radio = Broadcaster(dongle, list(on.values()))

    def order(self, packets: Mapping[int, bytes]) -> Sequence[int]:
        """Broadcast an order if it is the same for every radio; return the rows that it reached.

        Nothing is broadcast any more once the dongle has failed.

        Args:
            packets: By the row of the drone that it is for.
        """
        if self._radio.broken:
            return ()
        meant = {packets[row] for row in self._last if row in packets}
        if len(meant) != 1 or any(row not in packets for row in self._last):
            return ()
        self._radio.order(meant.pop())
        return tuple(self._last)

    def correct(self, corrections: Corrections) -> Sequence[int]:
        """Broadcast the poses of the drones that are on the air; return their rows."""
        if self._radio.broken:
            return ()
        for i, row in enumerate(corrections.agent.tolist()):
            if (last := self._last.get(row)) is not None:
                position, attitude = corrections.position[i], corrections.attitude[i]
                self._radio.show(last, pose(last, position.tolist(), attitude.tolist()))
        return tuple(self._last)

    def close(self) -> None:
        """Release the dongle."""
        self._radio.close()
