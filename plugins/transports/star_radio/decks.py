"""The cameras of the swarm's AI-decks, gathered into `Frames`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from star_core import Frames, Scene
from star_radio.camera.client import SHAPE, CameraClient

PORT: Final = 5000  # of an AI-deck


class Decks:
    """One client for each agent with a camera.

    Args:
        scene: The agents, with the cameras that they carry.
        addresses: Host, or host and port, by the agent's name.
        latency: From the exposure to the first packet of an image, s.
    """

    def __init__(self, scene: Scene, addresses: Mapping[str, str], latency: float) -> None:
        self._clients: dict[int, CameraClient] = {}
        for row, agent in enumerate(scene.agents):
            if agent.name in addresses:
                host, _, port = addresses[agent.name].partition(":")
                camera = agent.camera
                self._clients[row] = CameraClient(
                    host,
                    int(port or PORT),
                    shape=(camera.height, camera.width) if camera else SHAPE,
                    latency=latency,
                )

    def frames(self, began: float) -> Frames:
        """Return the images since the last call.

        Args:
            began: When mission time was 0, s of the computer's clock.
        """
        shots = [(row, shot) for row, client in self._clients.items() for shot in client.arrived()]
        shots.sort(key=lambda found: found[1].arrived)
        if not shots:
            return Frames.none()
        return Frames(
            agent=np.array([row for row, _shot in shots]),
            taken=np.array([shot.taken - began for _row, shot in shots]),
            arrived=np.array([shot.arrived - began for _row, shot in shots]),
            image=tuple(shot.image for _row, shot in shots),
        )

    def close(self) -> None:
        """Hang up."""
        for client in self._clients.values():
            client.close()
