"""The page of a flight in progress, and the program that serves it for `star_view.live_view`.

It runs in a process of its own.
"""

from __future__ import annotations

import json
import os
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any, Final

import numpy as np
import viser

from star_core import Event
from star_core.toolkit import messages_from
from star_view.camera_images import CameraStream, mosaic
from star_view.markdown import escaped
from star_view.messages import News, Watched
from star_view.page import add_dark_switch, open_page
from star_view.snapshot import Snapshot
from star_view.swarm_scene import SwarmScene

NICENESS: Final = 5  # the flight comes first
TRAIL: Final = 5.0  # s of mission time
PANEL_PERIOD: Final = 0.2  # s of wall time
EVENTS: Final = 8  # shown
MAX_SPEED: Final = 10.0


class LivePage:
    """The page of a flight in progress.

    Args:
        flight: What it shows.
        send: Called with what the operator does, as keywords.

    Attributes:
        server: Of the page.
        swarm: The agents on the page.
        land: Button that lands all agents.
        stop: Button that stops the motors.
        speed: Slider with the speed of the simulation; None in real time.
    """

    def __init__(self, flight: Watched, send: Callable[..., None]) -> None:
        self._send = send
        self._names = [agent.name for agent in flight.agents]
        self._trail: deque[Snapshot] = deque()
        self._events: deque[Event] = deque(maxlen=EVENTS)
        self._streams = [CameraStream() for _ in flight.agents]
        self._latest: tuple[Snapshot, float] | None = None
        self._panel_shown = 0.0
        self.server = open_page(flight.world, flight.port, flight.mission)
        self.swarm = SwarmScene(self.server, flight.agents, flight.radius)
        self._add_controls(self.server.gui, flight.speed)
        self.server.on_client_connect(lambda _client: send(connected=True))

    def show(self, news: News) -> None:
        """Show a flight as it is now."""
        now = self._with_trail(Snapshot.of_tick(news.tick))
        with self.server.atomic():
            self.swarm.show(now)
        self._events.extend(news.events)
        for row, image in news.images.items():
            self._streams[row].add(*image)
        for detections in news.detections:
            for row in set(detections.agent.tolist()):
                self._streams[row].add_tags(detections.of(detections.agent == row))
        self._latest = now, news.factor
        wall = time.monotonic()
        if wall - self._panel_shown >= PANEL_PERIOD:
            self._panel_shown = wall
            self._show_table(now, news.factor)
            self._show_images()

    def end(self, summary: Mapping[str, Any]) -> None:
        """Show how the flight ended."""
        if self._latest is not None:
            self._show_table(*self._latest)
        reason = f": {escaped(summary['reason'])}" if summary["reason"] else ""
        self._status.content = f"**{summary['outcome']}**{reason}"
        for control in (self.land, self.stop, self.speed):
            if control is not None:
                control.disabled = True

    def _show_table(self, now: Snapshot, factor: float) -> None:
        pace = f"{factor:.1f} times real time"
        self._status.content = (
            f"**{now.time:.1f} s** at {pace}\n\n{escaped(now.doing or 'no step')}"
        )
        self._states.content = now.states(self._names)
        self._log.content = self._log_text()

    def _log_text(self) -> str:
        """Return the latest events as a list in Markdown, the newest first."""
        return "\n".join(
            f"- {event.time:.1f} s {escaped(event.text)}" for event in reversed(self._events)
        )

    def _show_images(self) -> None:
        """Show the newest image of each camera with the tags in it."""
        pictures = zip(self._names, (stream.picture() for stream in self._streams), strict=True)
        if named := {name: picture for name, picture in pictures if picture is not None}:
            self._cameras.image = mosaic(named)
            self._cameras.visible = True

    def _with_trail(self, now: Snapshot) -> Snapshot:
        self._trail.append(now)
        while self._trail[0].time < now.time - TRAIL:
            self._trail.popleft()
        return replace(now, trail=np.array([snapshot.position for snapshot in self._trail]))

    def _add_controls(self, gui: viser.GuiApi, speed: float | None) -> None:
        self._status = gui.add_markdown("the flight begins")
        self.land = gui.add_button("land all", color="orange", icon=viser.Icon.PLANE_ARRIVAL)
        self.stop = gui.add_button(
            "stop motors", color="red", icon=viser.Icon.HAND_STOP,
            hint="Stops all motors at once: agents in the air fall.",
        )  # fmt: skip
        self.land.on_click(lambda _event: self._send(land_all=True))
        self.stop.on_click(lambda _event: self._send(stop_motors=True))
        self.speed: Any = None
        if speed is not None:
            self.speed = gui.add_slider(
                "speed", min=0.1, max=max(MAX_SPEED, speed), step=0.1, initial_value=speed,
                hint="Times real time.",
            )  # fmt: skip
            self.speed.on_update(lambda event: self._send(speed=event.target.value))
        self._states = gui.add_markdown("")
        self._cameras = gui.add_image(
            np.zeros((1, 1, 3), np.uint8), label="cameras", format="jpeg", visible=False
        )
        with gui.add_folder("events"):
            self._log = gui.add_markdown("")
        self.swarm.add_controls(gui)
        add_dark_switch(self.server)


def serve(descriptor: int) -> None:
    """Serve the page of the flight that another process sends.

    What the operator does is answered in JSON: nothing of the page is unpickled there.

    Args:
        descriptor: File descriptor of the inherited end of the connection.
    """
    os.nice(NICENESS)
    connection = Connection(descriptor)

    def send(**request: Any) -> None:
        with suppress(OSError):
            connection.send_bytes(json.dumps(request).encode())

    messages = messages_from(connection)
    page = LivePage(next(messages), send)
    send(address=page.server.address)
    for news in messages:
        if isinstance(news, News):
            page.show(news)
        else:
            page.end(news)
            page.server.flush()
            time.sleep(PANEL_PERIOD)  # until it is sent
            break
    page.server.close()
