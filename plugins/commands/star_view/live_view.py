"""Observer of ``star run --view``: shows the flight on a page that another process serves.

A tick only stores its tables. A thread of low rate sends the newest ones to the process: neither a
slow page nor a page that fails delays the flight.
"""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import time
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from threading import Event as Flag
from threading import Thread
from typing import Any, Final, TypeVar

from star_core import Detections, Event, Flight, Frames, Image, Odometry, Operator, Tick, hookimpl
from star_core.toolkit import python_process
from star_view.messages import PORT, News, Watched

RATE: Final = 15.0  # Hz of wall time: of the page
REAL_TIME: Final = 1.0  # speed at which a simulation can be watched
START_TIMEOUT: Final = 20.0  # s
BROWSER_TIMEOUT: Final = 30.0  # s
CLOSE_TIMEOUT: Final = 5.0  # s
WINDOW: Final = 1.0  # s of wall time over which the real-time factor is taken

log = logging.getLogger(__name__)
Item = TypeVar("Item")


class LiveView:
    """Shows a flight in the browser while it is flown.

    A simulation without a speed is slowed down to real time. It begins when the page is served; on
    a terminal, when a browser shows it.

    Args:
        radius: That the avoider keeps free around each agent, m; None if unknown.
        port: To serve on, or the next free one.
        wait_for_browser: Whether a simulation waits for a browser, for a while.
    """

    def __init__(
        self, radius: float | None, *, port: int = PORT, wait_for_browser: bool = False
    ) -> None:
        self._radius = radius
        self._port = port
        self._wait_for_browser = wait_for_browser
        self.address = ""
        self._served, self._connected, self._ended = Flag(), Flag(), Flag()
        self._tick: Tick | None = None
        # newest of each camera with its time, by row
        self._images: dict[int, tuple[float, Image]] = {}
        self._sent: dict[int, tuple[float, Image]] = {}
        self._detections: deque[Detections] = deque()
        self._events: deque[Event] = deque()

    @hookimpl
    def star_mission_started(self, flight: Flight, operator: Operator) -> None:
        self._operator = operator
        simulation = operator.simulation
        if simulation is not None and simulation.speed is None:
            simulation.speed = REAL_TIME
        self._process, self._connection = python_process("star_view.live_page")
        scene, speed = flight.scene, None if simulation is None else simulation.speed
        watched = Watched(
            flight.mission, scene.world, scene.agents, self._radius, speed, self._port
        )
        self._sender = Thread(target=self._send, args=(watched,), daemon=True)
        self._sender.start()
        Thread(target=self._receive, daemon=True).start()
        if not scene.realtime:
            self._wait()

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        frames = tick.telemetry.frames
        if len(frames.agent):
            timed = zip(frames.time.tolist(), frames.image, strict=True)
            self._images.update(zip(frames.agent.tolist(), timed, strict=True))
        if len((detections := tick.detections).tag):
            self._detections.append(detections)
        self._tick = tick

    @hookimpl
    def star_event(self, event: Event) -> None:
        self._events.append(event)

    @hookimpl
    def star_mission_ended(self, summary: Mapping[str, Any]) -> None:
        self._summary = {key: summary[key] for key in ("outcome", "reason")}
        self._ended.set()
        self._sender.join(CLOSE_TIMEOUT)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSE_TIMEOUT)
        self._process.kill()

    def _wait(self) -> None:
        """Wait until the page is served and, on a terminal, until a browser shows it."""
        self._served.wait(START_TIMEOUT)
        if self.address and self._wait_for_browser:
            sys.stderr.write(f"star: waiting up to {BROWSER_TIMEOUT:g} s for a browser\n")
            begun = time.monotonic()
            while not (self._connected.wait(0.1) or self._operator.stops):
                if time.monotonic() - begun > BROWSER_TIMEOUT:
                    return

    def _send(self, watched: Watched) -> None:
        """Send the newest tick to the page, at its rate, until the flight ends."""
        clocks: deque[tuple[float, float]] = deque()  # s: wall time, mission time
        with suppress(OSError):  # the process has ended
            self._connection.send(watched)
            ended, tick = False, None
            while not ended:
                ended = self._ended.wait(1 / RATE)
                if self._tick is tick or self._tick is None:
                    continue
                tick = self._tick
                clocks.append((time.monotonic(), tick.time))
                while clocks[-1][0] - clocks[0][0] > WINDOW:
                    clocks.popleft()
                self._connection.send(self._news(tick, _slope(clocks)))
            self._connection.send(self._summary)

    def _news(self, tick: Tick, factor: float) -> News:
        newest = self._images.copy()
        images = {row: image for row, image in newest.items() if self._sent.get(row) is not image}
        self._sent = newest
        events, detections = _drained(self._events), _drained(self._detections)
        telemetry = replace(tick.telemetry, odometry=Odometry.none(), frames=Frames.none())
        return News(replace(tick, telemetry=telemetry), factor, images, detections, events)

    def _receive(self) -> None:
        """Do what the operator asks for on the page."""
        with self._connection, suppress(EOFError, OSError):
            while True:
                self._answer(json.loads(self._connection.recv_bytes()))
        if not self._ended.is_set():
            log.warning("the view is closed: its process ended")
        self._served.set()
        self._connected.set()

    def _answer(self, answer: Mapping[str, Any]) -> None:
        match answer:
            case {"address": str(address)}:
                self.address = address
                sys.stderr.write(f"star: {address} shows the flight\n")
                self._served.set()
            case {"connected": True}:
                self._connected.set()
            case {"land_all": True}:
                self._operator.land_all()
            case {"stop_motors": True}:
                self._operator.stop_motors()
            case {"speed": float(speed) | int(speed)} if self._operator.simulation is not None:
                self._operator.simulation.speed = float(speed)


def _drained(queue: deque[Item]) -> tuple[Item, ...]:
    """Remove the items of a queue, and return them."""
    return tuple(queue.popleft() for _ in range(len(queue)))


def _slope(clocks: deque[tuple[float, float]]) -> float:
    """Return mission time over wall time; NaN if it is not known yet."""
    wall, mission = clocks[-1][0] - clocks[0][0], clocks[-1][1] - clocks[0][1]
    return mission / wall if wall > 0 else float("nan")
