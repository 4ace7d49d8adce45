"""Ground truth from motion capture, through the optional package ``motioncapture``."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Mapping
from importlib import import_module
from typing import Any, Final

import numpy as np

from star_core import Array, PluginError, Scene, Truth

log = logging.getLogger(__name__)

SPAN: Final = 0.05  # s, over which velocity is a difference of positions
OLD: Final = 0.1  # s: of a frame that is older nobody knows where its bodies are now
KEPT: Final = 64  # frames: 0.13 s at 500 Hz, the fastest systems


class MotionCapture:
    """Listens to a motion-capture system in a thread of its own.

    Args:
        scene: The agents.
        kind: The system, as ``motioncapture.connect`` names it: ``optitrack``, ``vicon``, ...
        hostname: Where it runs.
        names: The rigid body of each agent, by the agent's name; its own name if not given.

    Raises:
        PluginError: The package is not installed, or the system cannot be reached.
    """

    def __init__(
        self, scene: Scene, *, kind: str, hostname: str, names: Mapping[str, str] | None = None
    ) -> None:
        try:
            package = import_module("motioncapture")
        except ImportError as error:
            raise PluginError(
                "mocap needs the package 'motioncapture': pip install motioncapture"
            ) from error
        try:
            self._system: Any = package.connect(kind, {"hostname": hostname})
        except Exception as error:  # what a system's own library raises
            raise PluginError(f"mocap: no {kind!r} at {hostname!r}: {error}") from error
        self._bodies = [(names or {}).get(name, name) for name in scene.names]
        self._frames: deque[tuple[float, Array]] = deque(maxlen=KEPT)
        self._ended = False
        self._old = False
        self._thread = threading.Thread(target=self._listen, name="star-radio-mocap", daemon=True)
        self._thread.start()

    def truth(self, began: float) -> Truth | None:
        """Return the newest frame; None before the first. A body that is not seen is NaN.

        So is every body where the newest is older than `OLD`, of which a warning tells once.

        Args:
            began: When mission time was 0, s of the computer's clock.
        """
        frames = list(self._frames)
        if not frames:
            return None
        newest, poses = frames[-1]
        silent = time.monotonic() - newest
        if silent > OLD:
            poses = np.full_like(poses, np.nan)
            if not self._old:
                log.warning("radio: mocap says nothing: truth is unknown until it does")
        self._old = silent > OLD
        velocity = np.full((len(poses), 3), np.nan)
        before = [frame for frame in frames if frame[0] <= newest - SPAN] or frames[:1]
        then, earlier = before[-1]
        if newest > then:
            velocity = (poses[:, :3] - earlier[:, :3]) / (newest - then)
        return Truth(newest - began, poses[:, :3], velocity, poses[:, 3:])

    def close(self) -> None:
        """End the thread with the next frame, or leave it to wait for one."""
        self._ended = True

    def _listen(self) -> None:
        while not self._ended:
            try:
                self._system.waitForNextFrame()
                bodies = self._system.rigidBodies
            except Exception as error:  # noqa: BLE001 -- recorders only: nobody falls without it
                log.warning("radio: mocap ended: %s", error)
                return
            arrived = time.monotonic()
            poses = np.full((len(self._bodies), 7), np.nan)
            for row, name in enumerate(self._bodies):
                if name in bodies:
                    turn = bodies[name].rotation
                    poses[row, :3] = bodies[name].position
                    poses[row, 3:] = turn.x, turn.y, turn.z, turn.w
            self._frames.append((arrived, poses))
