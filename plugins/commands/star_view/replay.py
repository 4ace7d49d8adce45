"""Replays a flight on a page: a timeline with the events on it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import viser

from star_core import Run
from star_view.camera_images import Picture, mosaic
from star_view.markdown import escaped
from star_view.page import add_dark_switch, open_page
from star_view.snapshot import of_record
from star_view.swarm_scene import SwarmScene, color_of, segments
from star_view.world_scene import add_lines

RATE: Final = 20.0  # Hz: of the page
TRAIL: Final = 5.0  # s
MAX_POINTS: Final = 2000  # of the path of an agent
MAX_LABEL: Final = 90  # characters of an event
SPEEDS: Final = ("0.25 x", "0.5 x", "1 x", "2 x", "4 x", "8 x")


class Replay:
    """A page with a flight, its timeline and its events.

    Args:
        run: The flight.
        radius: That the avoider keeps free around each agent, m; None if unknown.
        port: To serve on, or the next free one.
        token: Of the page, as of `Gate`.

    Attributes:
        server: Of the page.
        swarm: The agents on the page.
        timeline: Slider with the mission time, s.
        status: What the agents do.
    """

    def __init__(
        self, run: Run, radius: float | None, *, port: int, token: str | None = None
    ) -> None:
        self._run = run
        self._time = run.arrays["time"]
        # saved images of each agent, by their times, ms
        self._frames = {name: run.images(name) for name in run.agents}
        self._shown: list[Path] = []
        self.server = open_page(run.world, port, run.summary["mission"], token)
        self._begun = False
        self._add_paths(self.server.scene)
        self.swarm = SwarmScene(self.server, run.swarm, radius)
        self._add_controls(self.server.gui)
        self.show(0)

    def serve(self, ended: Callable[[], bool]) -> None:
        """Play from the first browser on, until it is ended or an exception is raised."""
        self.server.on_client_connect(lambda _client: self._begin())
        last = time.monotonic()
        while not ended():
            time.sleep(1 / RATE)
            now = time.monotonic()
            if self._playing:
                moment = self.timeline.value + (now - last) * float(self._speed.value[:-2])
                if moment >= self._time[-1]:
                    self.play(on=False)
                self.timeline.value = min(moment, float(self._time[-1]))
            last = now

    def play(self, *, on: bool) -> None:
        """Play, from the beginning if the flight is at its end, or pause."""
        if on and self.timeline.value >= self._time[-1]:
            self.timeline.value = float(self._time[0])
        self._playing = on
        self._play.label = "pause" if on else "play"
        self._play.icon = viser.Icon.PLAYER_PAUSE if on else viser.Icon.PLAYER_PLAY

    def _begin(self) -> None:
        if not self._begun:
            self._begun = True
            self.play(on=True)

    def show(self, tick: int) -> None:
        """Show the flight at a tick."""
        now = of_record(self._run, tick, TRAIL)
        with self.server.atomic():
            self.swarm.show(now)
        self._show_images(round(1000 * now.time))
        self.status.content = (
            f"**{now.time:.2f} s** {escaped(now.doing)}\n\n{self._latest_event(now.time)}\n\n"
            f"{now.states(self._run.agents)}"
        )

    def _latest_event(self, now: float) -> str:
        """Return the latest event up to a time, s, as Markdown."""
        past = [event for event in self._run.summary["events"] if event["time"] <= now + 1e-6]
        return f"{past[-1]['time']:.2f} s {escaped(past[-1]['text'])}" if past else ""

    def _show_images(self, now: int) -> None:
        """Show the newest saved image of each camera at a time, ms, with the detected tags."""
        past = {
            row: (time, frames[time])
            for row, frames in enumerate(self._frames.values())
            if (time := max((stamp for stamp in frames if stamp <= now), default=None)) is not None
        }
        paths = [path for _, path in past.values()]
        if paths == self._shown:
            return
        self._shown, detections = paths, self._run.detections
        ms = np.round(1000 * detections.time)
        pictures = {
            self._run.agents[row]: Picture(
                np.asarray(image, np.uint8), detections.of((detections.agent == row) & (ms == time))
            )
            for row, (time, path) in past.items()
            if (image := cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) is not None
        }
        self._cameras.visible = bool(pictures)
        if pictures:
            self._cameras.image = mosaic(pictures)

    def _add_paths(self, page: viser.SceneApi) -> None:
        """Add the whole path of each agent, pale."""
        position = self._run.arrays.get("truth_position", self._run.arrays["estimate_position"])
        page.add_frame("/flown", show_axes=False)
        for row, name in enumerate(self._run.agents):
            path = position[:, row]
            path = path[np.isfinite(path).all(axis=1)]
            path = path[:: max(1, len(path) // MAX_POINTS)]
            if len(path) > 1:
                pale = (255 + np.array(color_of(row))) // 2
                add_lines(page, f"/flown/{name}", segments(path), tuple(pale), 1.0)

    def _add_controls(self, gui: viser.GuiApi) -> None:
        begin, end = float(self._time[0]), float(self._time[-1])
        summary = self._run.summary
        outcome = summary["outcome"] + (f": {summary['reason']}" if summary["reason"] else "")
        gui.add_markdown(f"**{escaped(summary['mission'])}** {escaped(outcome)}")
        events = [event for event in summary["events"] if begin <= event["time"] <= end]
        self.timeline: Any = gui.add_slider(
            "time (s)", min=begin, max=end, step=0.05, initial_value=begin,
            marks=tuple(dict.fromkeys(float(event["time"]) for event in events)),
        )  # fmt: skip
        self._playing = False
        self._play: Any = gui.add_button("play", icon=viser.Icon.PLAYER_PLAY)
        self._play.on_click(lambda _event: self.play(on=not self._playing))
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1 x")
        self._add_events(gui, events)
        self.status = gui.add_markdown("")
        self._cameras = gui.add_image(
            np.zeros((1, 1, 3), np.uint8), label="cameras", format="jpeg", visible=False
        )
        self.swarm.add_controls(gui)
        add_dark_switch(self.server)

        def update(_event: Any) -> None:
            tick = int(np.searchsorted(self._time, self.timeline.value))
            self.show(min(tick, len(self._time) - 1))

        self.timeline.on_update(update)

    def _add_events(self, gui: viser.GuiApi, events: list[dict[str, Any]]) -> None:
        """Add buttons to jump to the previous and the next event, and a list to jump to any."""
        labels = [f"{event['time']:.2f} s {event['text']}"[:MAX_LABEL] for event in events]
        times = [float(event["time"]) for event in events]
        chosen: Any = gui.add_dropdown("jump to event", list(dict.fromkeys(labels)) or [""])
        buttons = gui.add_button_group("event", ("◀ previous", "next ▶"))

        def jump(_event: Any) -> None:
            if chosen.value:
                self.timeline.value = times[labels.index(chosen.value)]

        def step(_event: Any) -> None:
            now = self.timeline.value
            if buttons.value.startswith("next"):
                later = [moment for moment in times if moment > now + 1e-6]
                self.timeline.value = min(later, default=now)
            else:
                earlier = [moment for moment in times if moment < now - 1e-6]
                self.timeline.value = max(earlier, default=now)

        chosen.on_update(jump)
        buttons.on_click(step)
