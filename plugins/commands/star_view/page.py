"""The page of every use: a server on this machine, with light, camera and world."""

from __future__ import annotations

from contextlib import redirect_stdout
from functools import partial
from io import StringIO
from typing import Final

import numpy as np
import viser

from star_core import World
from star_view.gate import Gate
from star_view.names import Name, show_names
from star_view.world_scene import add_world

LOOPBACK: Final = "127.0.0.1"
BACKGROUND: Final = {False: (247, 247, 245), True: (26, 28, 32)}  # by whether the page is dark
HEIGHT: Final = 0.3  # m above the floor, of the point that the camera looks at
FIELD_OF_VIEW: Final = 0.9  # rad, vertical
EYE: Final = np.array([-0.28, -0.68, 0.64])  # of the camera, times the room's diagonal
AWAY: Final = 2.4  # times as far, on a phone
PAN: Final = 0.7 * np.array([0.25, 0.61, 0.75])  # lower in the image, times the room's diagonal


class Page(viser.ViserServer):
    """A server of pages that only a browser at its whole address can see and use.

    Args:
        port: To serve on, or the next free one.
        title: Of the page.
        token: Of an earlier page, in whose place this one is served; a new one by default.

    Attributes:
        gate: Its guard.
        names: In its scene.

    Raises:
        PluginError: This version of viser cannot be guarded.
    """

    def __init__(self, port: int, title: str, token: str | None = None) -> None:
        self.names: list[Name] = []
        self.gate = Gate(LOOPBACK, self._control, token)
        with redirect_stdout(StringIO()), self.gate.guarding():  # viser prints a box
            super().__init__(host=LOOPBACK, port=port, label=title, verbose=False)

    @property
    def address(self) -> str:
        """Where the page is, and what its connection is to present as a token."""
        where = f"{LOOPBACK}:{self.get_port()}"
        return f"http://{where}/?websocket=ws://{where}/{self.gate.token}"

    def close(self) -> None:
        """Stop serving the page."""
        with redirect_stdout(StringIO()):
            self.stop()

    def _control(self, uuid: str) -> object | None:
        return self.gui._gui_input_handle_from_uuid.get(uuid)  # noqa: SLF001 -- viser has no other


def open_page(world: World, port: int, title: str, token: str | None = None) -> Page:
    """Serve a page with a world on `port` or the next free one; it requests nothing else."""
    server = Page(port, title, token)
    paint(server, dark=False)
    server.gui.main_panel.dock_right()
    server.gui.set_panel_label(title)
    page = server.scene
    page.configure_environment_map(hdri=None)  # else it is fetched from the internet
    page.configure_default_lights(enabled=True, cast_shadow=False)
    page.add_light_ambient("/light", intensity=1.2)
    low, high = np.array(world.fence.low), np.array(world.fence.high)
    centre, extent = (low + high) / 2, float(np.linalg.norm((high - low)[:2]))
    camera = server.initial_camera
    camera.fov = FIELD_OF_VIEW
    target = np.array([*centre[:2], low[2] + HEIGHT])
    camera.position = tuple(target + extent * EYE)
    camera.look_at = tuple(target)

    def step_back(client: viser.ClientHandle) -> None:
        if client.camera.aspect < 1.0:  # a phone's, on which viser's panel covers the lower half
            lower = target - extent * PAN
            client.camera.position = tuple(lower + extent * EYE * AWAY)
            client.camera.look_at = tuple(lower)

    server.on_client_connect(step_back)
    server.names += add_world(page, world)
    server.on_client_connect(partial(show_names, server.names))
    return server


def paint(server: viser.ViserServer, *, dark: bool) -> None:
    """Make a page light or dark."""
    server.gui.configure_theme(
        show_logo=False, show_share_button=False, control_width="large", dark_mode=dark
    )
    background = np.full((1, 1, 3), BACKGROUND[dark], np.uint8)
    server.scene.set_background_image(background, format="png")


def add_dark_switch(server: Page) -> None:
    """Add a switch between a light and a dark page.

    Until it is used, the page is as its browser prefers, where that tells servers: Chromium does.
    """
    box: viser.GuiInputHandle[bool] = server.gui.add_checkbox("dark", initial_value=False)
    used = False

    def switch(event: viser.GuiEvent[viser.GuiInputHandle[bool]]) -> None:
        nonlocal used
        used = used or event.client is not None
        paint(server, dark=event.target.value)

    def follow(dark: bool) -> None:  # noqa: FBT001 -- the gate calls it with this argument
        if not used:
            box.value = dark  # type: ignore[misc]  # viser declares no setter

    box.on_update(switch)
    server.gate.on_scheme = follow
