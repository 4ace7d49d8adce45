"""Ground truth from motion capture, through the optional package ``motioncapture``."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from importlib.util import find_spec
from multiprocessing import Pipe
from typing import Final

import numpy as np

from star_core import PluginError, Scene, Truth
from star_radio.mocap_process import Frame

log = logging.getLogger(__name__)

VELOCITY_INTERVAL: Final = 0.05  # s, over which velocity is a difference of positions
MAX_FRAME_AGE: Final = 0.1  # s: older frames are not used as ground truth
MAX_FRAMES: Final = 64  # 0.13 s at 500 Hz, the fastest systems
CONNECT_TIMEOUT: Final = 10.0  # s
EXIT_TIMEOUT: Final = 2.0  # s, for a process that was killed
ENDED: Final = "its process has ended"
SERVE: Final = "from star_radio.mocap_process import serve; serve"


class MotionCapture:
    """Receives frames of a motion-capture system through a separate process.

    Args:
        scene: The agents.
        type: Type of the system, as in ``motioncapture.connect``: ``optitrack``, ``vicon``, ...
        hostname: Its host.
        names: Rigid-body names by agent name; the agent's name if not given.
        timeout: For connecting, s.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        type: str,  # noqa: A002 -- the option's name
        hostname: str,
        names: Mapping[str, str] | None = None,
        timeout: float = CONNECT_TIMEOUT,
    ) -> None:
        if find_spec("motioncapture") is None:
            raise PluginError(
                "mocap needs the package 'motioncapture': pip install motioncapture",
                "missing-package",
            )
        self._frames: deque[Frame] = deque(maxlen=MAX_FRAMES)
        self._closing = False
        self._stale = False
        self._thread = threading.Thread(target=self._listen, name="star-radio-mocap", daemon=True)
        self._connection, theirs = Pipe()
        with theirs:
            self._process = subprocess.Popen(  # noqa: S603 -- this very interpreter
                [sys.executable, "-c", f"{SERVE}({theirs.fileno()})"],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                process_group=0,  # the flight handles a keyboard interrupt
                env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            )
        bodies = [(names or {}).get(name, name) for name in scene.names]
        self._connection.send((type, hostname, bodies, timeout))
        if (problem := self._connected(timeout)) is not None:
            self._end()
            raise PluginError(f"mocap: no {type!r} at {hostname!r}: {problem}", "no-answer")
        self._thread.start()

    def truth(self, began: float) -> Truth | None:
        """Return the newest frame; None before the first. Bodies that are not seen are NaN.

        All bodies are NaN if the newest frame is older than `MAX_FRAME_AGE`; a warning is logged
        once.

        Args:
            began: Mission time 0, s of the computer's clock.
        """
        frames = list(self._frames)
        if not frames:
            return None
        newest, poses = frames[-1]
        silent = time.monotonic() - newest
        if silent > MAX_FRAME_AGE:
            poses = np.full_like(poses, np.nan)
            if not self._stale:
                log.warning("radio: mocap sends no frames: no ground truth until it does")
        self._stale = silent > MAX_FRAME_AGE
        velocity = np.full((len(poses), 3), np.nan)
        before = [frame for frame in frames if frame[0] <= newest - VELOCITY_INTERVAL] or frames[:1]
        then, earlier = before[-1]
        if newest > then:
            velocity = (poses[:, :3] - earlier[:, :3]) / (newest - then)
        return Truth(newest - began, poses[:, :3], velocity, poses[:, 3:])

    def close(self) -> None:
        """End the process and the thread. Safe to call twice."""
        self._closing = True
        self._end()

    def _connected(self, timeout: float) -> str | None:
        """Wait for the connection; return the error, None for success."""
        try:
            if self._connection.poll(timeout):
                return self._connection.recv() or None
        except (EOFError, OSError):
            return ENDED
        return f"no answer in {timeout:g} s"

    def _listen(self) -> None:
        """Receive frames until the process ends, which closes the connection."""
        problem = ENDED
        try:
            while not isinstance(answer := self._connection.recv(), str):
                self._frames.append(answer)
            problem = answer
        except (EOFError, OSError):
            pass
        if not self._closing:
            log.warning("radio: mocap ended: %s", problem)

    def _end(self) -> None:
        """Kill the process, which ends the thread."""
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(EXIT_TIMEOUT)
        if self._thread.ident is not None:
            self._thread.join(EXIT_TIMEOUT)
        self._connection.close()
