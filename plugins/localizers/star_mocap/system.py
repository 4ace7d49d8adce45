"""A motion-capture system: the frames of a source, in the map and on the computer's clock."""

from __future__ import annotations

import logging
import math
import subprocess
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any, Final, NamedTuple

import numpy as np

from star_core import Array, PluginError, Registry, Scene, Transform
from star_core.toolkit import fill_defaults, messages_from, python_process, quaternion_from_euler
from star_mocap.source import KIND, Frame

log = logging.getLogger(__name__)

MAX_FRAMES: Final = 512  # 1 s at 500 Hz, the fastest systems
CLOCK_WINDOW: Final = 2.0  # s
EXIT_TIMEOUT: Final = 2.0  # s, for a process that was killed
START_TIME: Final = 5.0  # s, in which the process starts
ENDED: Final = "its process has ended"


class MapFrame(NamedTuple):
    """The measurements of one time.

    Attributes:
        taken: When, s of the computer's clock; NaN if unknown.
        arrived: Arrival, s of the computer's clock, without jitter if the system has a clock.
        poses: (N, 7) of the agents' bodies: position, m, and quaternion x, y, z, w in the map; NaN
            for those that are not visible.
        markers: (M, 3) of markers that belong to no body, m.
    """

    taken: float
    arrived: float
    poses: Array
    markers: Array


class CaptureClock:
    """Converts times of a system's clock to the computer's, by its frames with the least delay.

    The least difference between arrival and sending in the last `CLOCK_WINDOW` to twice that is
    nearest to the offset of the clocks (Cristian, Distributed Computing 3, 1989).
    """

    def __init__(self) -> None:
        self._began = -math.inf  # s, of the current window
        self._offset = self._before = math.inf  # s, of the current and the previous window

    def time(self, sent: float, arrived: float) -> float:
        """Return when a frame arrived, s of the computer's clock, without jitter.

        Args:
            sent: s of the system's clock.
            arrived: s of the computer's clock.
        """
        if abs(arrived - sent - self._offset) > CLOCK_WINDOW:  # it has restarted
            self._before = math.inf
            self._began = -math.inf
        if arrived - self._began > CLOCK_WINDOW:
            self._before = self._offset if math.isfinite(self._began) else math.inf
            self._began, self._offset = arrived, math.inf
        self._offset = min(self._offset, arrived - sent)
        return sent + min(self._offset, self._before)


class CaptureFrames:
    """The last frames of a system, in the map and on the computer's clock.

    Args:
        scene: The agents.
        options: As `system_options` describes them.
    """

    def __init__(self, scene: Scene, options: Mapping[str, Any]) -> None:
        bodies = [options["bodies"].get(name, name) for name in scene.names]
        self._rows = {body: row for row, body in enumerate(bodies)}
        turn, self._tilt = math.radians(options["yaw_deg"]), options["up"] == "y"
        self._frame = Transform(np.array([turn]), np.array([options["origin"]], float))
        roll, yaw = (math.pi / 2 if self._tilt else 0.0), turn
        self._turn = quaternion_from_euler(*(np.array([angle]) for angle in (roll, 0.0, yaw)))[0]
        self._clock = CaptureClock()
        self._new: deque[MapFrame] = deque(maxlen=MAX_FRAMES)
        self._recent: deque[MapFrame] = deque(maxlen=MAX_FRAMES)

    @staticmethod
    def now() -> float:
        """Return the time on the clock of the frames, s."""
        return time.monotonic()

    def take(self) -> list[MapFrame]:
        """Return the frames that arrived since the last call."""
        frames = []
        while self._new:
            frames.append(self._new.popleft())
        return frames

    def recent(self) -> list[MapFrame]:
        """Return the last frames, at most `MAX_FRAMES`."""
        return list(self._recent)

    def add(self, arrived: float, frame: Frame) -> None:
        """Add a frame that arrived at a time, s of the computer's clock."""
        taken = math.nan
        if math.isfinite(frame.captured):
            measured = math.isfinite(frame.processing)
            sent = frame.captured + (frame.processing if measured else 0.0)
            arrived = self._clock.time(sent, arrived)
            taken = arrived - frame.processing  # NaN if that is unknown
        poses = np.full((len(self._rows), 7), np.nan)
        for name in self._rows.keys() & frame.bodies.keys():
            poses[self._rows[name]] = frame.bodies[name]
        mapped = MapFrame(taken, arrived, self._in_map(poses), self._points(frame.markers))
        self._new.append(mapped)
        self._recent.append(mapped)

    def _in_map(self, poses: Array) -> Array:
        """Return (N, 7) poses in the map."""
        turned = _product(self._turn, poses[:, 3:])
        return np.column_stack([self._points(poses[:, :3]), turned])

    def _points(self, points: Array | Sequence[Sequence[float]]) -> Array:
        """Return (M, 3) points in the map, m."""
        points = np.array(points, float).reshape(-1, 3)
        if self._tilt:
            points = np.column_stack([points[:, 0], -points[:, 2], points[:, 1]])
        return self._frame.apply(points)


class MotionCapture(CaptureFrames):
    """Receives the frames of a source through its process.

    Args:
        registry: Where sources are found.
        scene: Agents, and the folder of files.
        options: As `system_options` describes them; some source.

    Raises:
        PluginError: The source does not send a frame in time.
    """

    def __init__(self, registry: Registry, scene: Scene, options: Mapping[str, Any]) -> None:
        super().__init__(scene, options)
        ((self._name, chosen),) = options["source"].items()
        spec = registry.find(KIND, self._name).offer
        arguments = fill_defaults(chosen, spec.options)
        for name in spec.files:
            arguments[name] = str(scene.file(arguments[name]))
        self._closing = False
        self._thread = threading.Thread(target=self._listen, name="star-mocap", daemon=True)
        self._process, self._connection = python_process("star_mocap.source_process")
        timeout = options["connect_timeout"]
        self._connection.send((spec.frames, arguments, timeout))
        if problem := self._first(timeout):
            self._end()
            raise PluginError(f"motion capture: source {self._name!r}: {problem}", "no-answer")
        self._thread.start()

    def close(self) -> None:
        """End the process and the thread. Safe to call twice."""
        self._closing = True
        self._end()

    def _first(self, timeout: float) -> str:
        """Wait for the first frame; return what failed, if anything."""
        try:
            if self._connection.poll(timeout + START_TIME):
                return self._receive(self._connection.recv())
        except (EOFError, OSError):
            pass
        return f"no frame in {timeout:g} s"

    def _listen(self) -> None:
        """Receive frames until the process ends, which closes the connection."""
        problem = next(filter(None, map(self._receive, messages_from(self._connection))), ENDED)
        if not self._closing:
            log.warning("motion capture: source %r ended: %s", self._name, problem)

    def _receive(self, message: Any) -> str:
        """Add the frame of a message; return the text of one that is an error."""
        if isinstance(message, str):
            return message
        arrived, *fields = message
        self.add(arrived, Frame(*fields))
        return ""

    def _end(self) -> None:
        """Kill the process, which ends the thread."""
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(EXIT_TIMEOUT)
        if self._thread.ident is not None:
            self._thread.join(EXIT_TIMEOUT)
        self._connection.close()


def _product(first: Array, second: Array) -> Array:
    """Return the (N, 4) products of one quaternion x, y, z, w with others, (N, 4)."""
    x, y, z, w = first
    a, b, c, d = second.T
    return np.column_stack(
        [
            w * a + x * d + y * c - z * b,
            w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d,
            w * d - x * a - y * b - z * c,
        ]
    )
