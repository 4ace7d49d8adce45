"""Replays a flight on a page that viser serves."""

from __future__ import annotations

import math
import time
from contextlib import redirect_stdout
from io import StringIO
from typing import Any, Final

import numpy as np
import viser

from star_core import AgentPhase, Array, Run, Scene
from star_view.world_scene import add_world

LOOPBACK: Final = "127.0.0.1"
RATE: Final = 20.0  # Hz: of the page
TRAIL: Final = 5.0  # s
AXES: Final = 0.15  # m
SIGMAS: Final = 2.0  # of the ellipsoids
SPEEDS: Final = ("0.25 x", "0.5 x", "1 x", "2 x", "4 x", "8 x")
PALETTE: Final = (
    (0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233),
    (90, 90, 90), (240, 228, 66),
)  # fmt: skip


class Viewer:
    """A page with a flight, its timeline and its events.

    Args:
        run: The flight.
        scene: Adds the agents' cameras, if known.
        port: To serve on, or the next free one.
    """

    def __init__(self, run: Run, scene: Scene | None, *, port: int) -> None:
        self._run = run
        self._time = run.arrays["time"]
        self._position = run.arrays.get("truth_position", run.arrays["estimate_position"])
        self._attitude = run.arrays.get("truth_attitude", _level(run.arrays["estimate_yaw"]))
        with redirect_stdout(StringIO()):  # viser prints a box
            self._server = viser.ViserServer(host=LOOPBACK, port=port, verbose=False)
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._add_light_and_camera()
        add_world(self._server.scene, run.world)
        self._add_agents(scene)
        self._add_controls()
        self._playing_since: float | None = None
        self.show(0)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{LOOPBACK}:{self._server.get_port()}"

    def serve(self) -> None:
        """Play when asked to, until an exception such as KeyboardInterrupt ends it."""
        last = time.monotonic()
        while True:
            time.sleep(1 / RATE)
            now = time.monotonic()
            if self._play.value:
                moment = self._timeline.value + (now - last) * float(self._speed.value[:-2])
                if moment >= self._time[-1]:
                    self._play.value = False
                self._timeline.value = min(moment, float(self._time[-1]))
            last = now

    def close(self) -> None:
        """Stop serving."""
        with redirect_stdout(StringIO()):
            self._server.stop()

    def show(self, tick: int) -> None:
        """Show the flight at a tick."""
        begin = int(np.searchsorted(self._time, self._time[tick] - TRAIL))
        estimate = self._run.arrays["estimate_position"][tick]
        std = self._run.arrays.get("estimate_position_std")
        rows = ["| agent | phase | z (m) | battery (V) |", "|---|---|---|---|"]
        with self._server.atomic():
            for i, name in enumerate(self._run.agents):
                here = self._position[tick, i]
                known = bool(np.isfinite(here).all())
                agent, trail, belief = self._agents[i], self._trails[i], self._ellipsoids[i]
                agent.visible = known
                if known:
                    agent.position = here
                    agent.wxyz = self._attitude[tick, i, [3, 0, 1, 2]]
                path = self._position[begin : tick + 1, i]
                path = path[np.isfinite(path).all(axis=1)]
                if trail is not None and len(path) > 1:
                    trail.points = np.stack([path[:-1], path[1:]], axis=1).astype(np.float32)
                if belief is not None and std is not None:
                    believed = np.isfinite(estimate[i]).all() and np.isfinite(std[tick, i]).all()
                    belief.visible = bool(believed and self._beliefs.value)
                    if believed:
                        belief.position = estimate[i]
                        belief.scale = tuple(np.maximum(SIGMAS * std[tick, i], 0.005).tolist())
                phase = AgentPhase(int(self._run.arrays["phase"][tick, i])).name.lower()
                battery = self._run.arrays["battery"][tick, i]
                volts = f"{battery:.2f}" if math.isfinite(battery) else ""
                rows.append(f"| {name} | {phase.replace('_', ' ')} | {here[2]:.2f} | {volts} |")
        moment = float(self._time[tick])
        self._status.content = "\n".join([*rows, "", f"**{moment:.2f} s** {self._doing(moment)}"])

    def _doing(self, moment: float) -> str:
        """Return the steps that are executed at a mission time."""
        current = [
            f"{step['verb']} {', '.join(step['agents'])}"
            for step in self._run.summary["steps"]
            if step["begun_s"] <= moment and (step["ended_s"] is None or moment < step["ended_s"])
        ]
        return "; ".join(current)

    def _add_agents(self, scene: Scene | None) -> None:
        page = self._server.scene
        self._agents: list[Any] = []
        self._trails: list[Any] = []
        self._ellipsoids: list[Any] = []
        for i, name in enumerate(self._run.agents):
            color = PALETTE[i % len(PALETTE)]
            self._agents.append(
                page.add_frame(f"/agents/{name}", axes_length=AXES, axes_radius=0.008)
            )
            page.add_icosphere(f"/agents/{name}/body", radius=0.045, color=color)
            page.add_label(f"/agents/{name}/name", name, position=(0.0, 0.0, 0.1))
            camera = None if scene is None else scene.agents[i].camera
            if camera is not None:
                x, y, z, w = camera.rotation
                page.add_camera_frustum(
                    f"/agents/{name}/camera",
                    fov=2 * math.atan2(camera.height / 2, camera.matrix[1]),
                    aspect=camera.width / camera.height,
                    scale=0.15,
                    thickness=0.004,
                    color=color,
                    wxyz=(w, x, y, z),
                    position=camera.position,
                )
            start = self._position[0, i]
            line = np.stack([start, start])[None]
            self._trails.append(
                page.add_line_segments(f"/trails/{name}", line, color, thickness=0.012)
            )
            path = self._position[:, i]
            path = path[np.isfinite(path).all(axis=1)][:: max(1, len(path) // 2000)]
            if len(path) > 1:
                pieces = np.stack([path[:-1], path[1:]], axis=1)
                pale = (255 + 2 * np.array(color, np.uint8).astype(int)) // 3
                page.add_line_segments(
                    f"/paths/{name}", pieces, np.tile(pale, (len(pieces), 2, 1)), thickness=0.004
                )
            self._ellipsoids.append(
                page.add_icosphere(f"/estimates/{name}", radius=1.0, color=color, opacity=0.3)
            )

    def _add_light_and_camera(self) -> None:
        """Light the scene without a picture of surroundings, and look at it from the south-west."""
        page = self._server.scene
        page.configure_environment_map(hdri=None)
        page.configure_default_lights(enabled=True, cast_shadow=False)
        page.add_light_ambient("/light", intensity=1.2)
        low, high = np.array(self._run.world.fence.low), np.array(self._run.world.fence.high)
        centre = (low + high) / 2
        self._server.initial_camera.position = tuple(centre + (high - low) * (-0.5, -0.9, 1.3))
        self._server.initial_camera.look_at = (*centre[:2], float(low[2]))

    def _add_controls(self) -> None:
        page, end = self._server.gui, float(self._time[-1])
        summary = self._run.summary
        page.add_markdown(f"## {summary['mission']}: {summary['outcome']}")
        self._timeline: Any = page.add_slider(
            "time (s)", min=float(self._time[0]), max=end, step=0.05, initial_value=0.0
        )
        self._play: Any = page.add_checkbox("play", initial_value=False)
        self._speed = page.add_dropdown("speed", SPEEDS, initial_value="1 x")
        self._beliefs = page.add_checkbox(f"estimates ({SIGMAS:g} std)", initial_value=True)
        self._status = page.add_markdown("")
        labels = [f"{event['time']:.2f} s {event['text']}"[:90] for event in summary["events"]]
        events = page.add_dropdown("jump to event", ["", *dict.fromkeys(labels)])

        def update(_event: Any) -> None:
            tick = int(np.searchsorted(self._time, self._timeline.value))
            self.show(min(tick, len(self._time) - 1))

        def jump(_event: Any) -> None:
            if events.value:
                moment = summary["events"][labels.index(events.value)]["time"]
                self._timeline.value = float(min(max(moment, self._time[0]), end))

        self._timeline.on_update(update)
        self._beliefs.on_update(update)
        events.on_update(jump)


def _level(yaw: Array) -> Array:
    """Return level attitudes (T, N, 4) with the headings (T, N), rad."""
    level = np.zeros((*yaw.shape, 4))
    level[..., 2], level[..., 3] = np.sin(yaw / 2), np.cos(yaw / 2)
    return level
