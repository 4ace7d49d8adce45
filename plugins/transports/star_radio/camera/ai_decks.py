"""Cameras of the swarm's AI-decks: collects their images as `Frames` and logs lost cameras."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from star_core import Frames, Scene
from star_radio.camera.address import host_and_port
from star_radio.camera.client import SHAPE, CameraClient

log = logging.getLogger(__name__)


class AiDecks:
    """One client for each agent with a camera.

    A deck that is unreachable, disconnects or sends images of the wrong size causes one warning,
    and another only after an image of it has arrived again.

    The stock streamer sends no timestamps. An exposure is assumed to be `latency` before the
    arrival of the image's first packet: the second half of the exposure, the read-out and, with
    JPEG, the compression. The duration of the transfer is measured.

    Args:
        scene: The agents with their cameras.
        addresses: host or host:port, by the agent's name.
        latency: From the middle of the exposure to the first packet of an image, s.
    """

    def __init__(self, scene: Scene, addresses: Mapping[str, str], latency: float) -> None:
        self._latency = latency
        self._decks: dict[int, _AiDeck] = {}
        for row, agent in enumerate(scene.agents):
            if agent.name in addresses:
                host, port = host_and_port(addresses[agent.name])
                camera = agent.camera
                shape = (camera.height, camera.width) if camera else SHAPE
                client = CameraClient(host, port, shape=shape)
                self._decks[row] = _AiDeck(agent.name, shape, client)

    def connect(self, timeout: float) -> None:
        """Wait up to `timeout` s until all decks are connected; warn of those that are not.

        A missing camera does not ground its agent.
        """
        until = time.monotonic() + timeout
        for deck in self._decks.values():
            deck.client.reached(max(0.0, until - time.monotonic()))
        for deck in self._decks.values():
            deck.watch(seen=False)

    def frames(self, began: float) -> Frames:
        """Return the images since the last call.

        Args:
            began: When mission time was 0, s of the computer's clock.
        """
        shots = []
        for row, deck in self._decks.items():
            arrived = deck.client.arrived()
            deck.watch(seen=bool(arrived))
            shots += [(row, shot) for shot in arrived]
        shots.sort(key=lambda found: found[1].arrived)
        if not shots:
            return Frames.none()
        return Frames(
            agent=np.array([row for row, _shot in shots]),
            taken=np.array([shot.began - self._latency - began for _row, shot in shots]),
            arrived=np.array([shot.arrived - began for _row, shot in shots]),
            image=tuple(shot.image for _row, shot in shots),
        )

    def close(self) -> None:
        """Close all connections."""
        for deck in self._decks.values():
            deck.client.hang_up()
        for deck in self._decks.values():
            deck.client.close()


@dataclass(slots=True)
class _AiDeck:
    """One deck, and whether its loss has been logged."""

    name: str
    shape: tuple[int, int]
    client: CameraClient
    lost: bool = False

    def watch(self, *, seen: bool) -> None:
        """Log when the camera is lost and when it is back.

        Args:
            seen: Whether an image has just arrived. Only that counts as back: a deck that accepts
                connections and sends nothing would otherwise alternate between back and lost.
        """
        if seen:
            if self.lost:
                log.info("radio: the camera of %s is back", self.name)
            self.lost = False
        elif not self.lost and (why := self._fault()) is not None:
            log.warning("radio: the camera of %s is not available: %s", self.name, why)
            self.lost = True

    def _fault(self) -> str | None:
        fault = self.client.fault
        if fault is None and (counts := self.client.counts).wrong and not counts.images:
            height, width = self.shape
            return f"it sends images that are not {width} x {height} px"
        return fault
