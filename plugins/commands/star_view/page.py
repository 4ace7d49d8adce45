"""The page of every use: a server on this machine, with light, camera and world."""

from __future__ import annotations

from contextlib import redirect_stdout
from hmac import compare_digest
from io import StringIO
from typing import Any, Final

import numpy as np
import viser

from star_core import World
from star_view.world_scene import add_world

LOOPBACK: Final = "127.0.0.1"
BACKGROUND: Final = (247, 247, 245)
HEIGHT: Final = 0.3  # m above the floor, of the point that the camera looks at
FIELD_OF_VIEW: Final = 0.9  # rad, vertical


def open_page(world: World, port: int, title: str) -> viser.ViserServer:
    """Serve a page with a world on `port` or the next free one; it requests nothing else."""
    with redirect_stdout(StringIO()):  # viser prints a box
        server = viser.ViserServer(host=LOOPBACK, port=port, label=title, verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
    server.gui.main_panel.dock_right()
    server.gui.set_panel_label(title)
    page = server.scene
    page.set_background_image(np.full((1, 1, 3), BACKGROUND, np.uint8), format="png")
    page.configure_environment_map(hdri=None)  # else it is fetched from the internet
    page.configure_default_lights(enabled=True, cast_shadow=False)
    page.add_light_ambient("/light", intensity=1.2)
    low, high = np.array(world.fence.low), np.array(world.fence.high)
    centre, extent = (low + high) / 2, float(np.linalg.norm((high - low)[:2]))
    camera = server.initial_camera
    camera.fov = FIELD_OF_VIEW
    target = np.array([*centre[:2], low[2] + HEIGHT])
    camera.position = tuple(target + extent * np.array([-0.28, -0.68, 0.64]))
    camera.look_at = tuple(target)
    add_world(page, world)
    return server


def address(server: viser.ViserServer, token: str = "") -> str:
    """Return where a page is, and what its connection is to present as a token, if any."""
    where = f"{LOOPBACK}:{server.get_port()}"
    return f"http://{where}" + (f"/?websocket=ws://{where}/{token}" if token else "")


def presents(server: viser.ViserServer, client: int | None, token: str) -> bool:
    """Return whether a client has connected with a token."""
    connections: Any = server._websock_server._live_connections  # noqa: SLF001 -- viser has no other
    connection = connections.get(client)
    return connection is not None and compare_digest(connection.request.path, f"/{token}")


def close(server: viser.ViserServer) -> None:
    """Stop serving a page."""
    with redirect_stdout(StringIO()):
        server.stop()
