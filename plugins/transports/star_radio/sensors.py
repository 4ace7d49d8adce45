"""What is received beside the links to the drones: images of AI-decks, and motion capture."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from star_core import Frames, Scene, Truth
from star_core.toolkit import Progress
from star_radio.options import RadioOptions

if TYPE_CHECKING:
    from star_radio.camera.ai_decks import AiDecks
    from star_radio.mocap import TrueBodies


class Sensors:
    """The cameras and the motion-capture system of a scene, where the options name some.

    Raises:
        PluginError: The motion-capture system is not available.
    """

    def __init__(self, scene: Scene, options: RadioOptions) -> None:
        self._timeout = options.response_timeout
        self._mocap: TrueBodies | None = None
        if options.mocap:
            from star_radio.mocap import TrueBodies  # finds all plugins again

            self._mocap = TrueBodies(scene, options.mocap)
        self._ai_decks: AiDecks | None = None
        if options.cameras:
            from star_radio.camera.ai_decks import AiDecks  # OpenCV is slow to import

            self._ai_decks = AiDecks(scene, options.cameras, options.camera_latency)

    def connect(self) -> None:
        """Connect to the cameras, and warn of those that do not answer."""
        if self._ai_decks is not None:
            self._ai_decks.connect(self._timeout)

    def frames(self, began: float) -> Frames:
        """Return the images since the last call; `began` is mission time 0 on the clock, s."""
        return Frames.none() if self._ai_decks is None else self._ai_decks.frames(began)

    def truth(self, began: float) -> Truth | None:
        """Return the newest poses of the motion-capture system, if there is one."""
        return None if self._mocap is None else self._mocap.truth(began)

    def close(self) -> None:
        """Close all connections. Safe to call twice."""
        for resource in (self._ai_decks, self._mocap):
            if resource is not None:
                resource.close()


def connecting(agents: int, detail: Callable[[], str]) -> Progress:
    """Return the progress of opening the links."""
    return Progress("radio: connected", agents, unit="agents", detail=detail, announced=True)
