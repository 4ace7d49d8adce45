"""What a fleet serves over TCP, as AI-decks do over WiFi: links and cameras."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial

from star_core import Scene
from star_fleet.aideck import AideckServer, CrtpOverTcp
from star_fleet.server import Fleet
from star_fleet.tcp import Switchboard


class Wifi:
    """TCP ports for the agents of a fleet, in the order of their rows.

    Args:
        fleet: Fleet whose vehicles are reached, and whose cameras are streamed.
        scene: That of the fleet.
        host: Address to serve at.
        links: Port of the first agent's link, 0 for free ones; None for no links.
        cameras: Port of the first camera, 0 for free ones; None for no cameras.
        jpeg: Whether cameras compress their images.

    Attributes:
        links: ``tcp://host:port`` by the row of the agent.
        cameras: ``host:port`` by the row of the agent, of those that have a camera.

    Raises:
        PluginError: A port is not available.
    """

    def __init__(
        self,
        fleet: Fleet,
        scene: Scene,
        host: str,
        *,
        links: int | None,
        cameras: int | None,
        jpeg: bool = False,
    ) -> None:
        self.links: dict[int, str] = {}
        self.cameras: dict[int, str] = {}
        opened: dict[int, CrtpOverTcp] = {}
        decks: dict[int, AideckServer] = {}
        with ExitStack() as stack:
            board = Switchboard()
            stack.callback(board.close)
            for row, agent in enumerate(scene.agents):
                if links is not None:
                    handle, port = partial(fleet.handle, row), links and links + row
                    opened[row] = CrtpOverTcp(host, port, handle, switchboard=board)
                    stack.callback(opened[row].close)
                    self.links[row] = "tcp://{}:{}".format(*opened[row].address)
                if cameras is not None and agent.camera is not None:
                    port = cameras and cameras + len(decks)
                    shape = agent.camera.height, agent.camera.width
                    decks[row] = AideckServer(host, port, shape=shape, jpeg=jpeg, switchboard=board)
                    stack.callback(decks[row].close)
                    self.cameras[row] = "{}:{}".format(*decks[row].address)
            self._opened = stack.pop_all()
        for row, link in opened.items():
            fleet.listen(row, link.push)
        for row, deck in decks.items():  # while no client is connected, no images are rendered
            fleet.watch(row, deck.publish, partial(getattr, deck, "connected"))

    def close(self) -> None:
        """Disconnect all clients and close the ports."""
        self._opened.close()
