"""What a fleet serves over TCP, as AI-decks do over WiFi: links and cameras."""

from __future__ import annotations

from contextlib import ExitStack

from star_core import Scene
from star_fleet.aideck.crtp import CrtpOverTcp
from star_fleet.aideck.server import AideckServer
from star_fleet.aideck.switchboard import Switchboard
from star_fleet.server import Fleet


class Wifi:
    """TCP ports for the agents of a fleet, in the order of their rows.

    Args:
        fleet: Whose vehicles are reached, and whose cameras are streamed.
        scene: That of the fleet.
        host: Address to serve at.
        links: Port of the first agent's link, 0 for free ones; None for no links.
        cameras: Port of the first camera, 0 for free ones; None for none.
        jpeg: Whether cameras compress their images.

    Attributes:
        links: ``tcp://host:port`` by the row of the agent.
        cameras: ``host:port`` by the row of the agent, of those that have a camera.

    Raises:
        PluginError: A port cannot be had.
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
        decks: dict[int, AideckServer] = {}
        with ExitStack() as opened:
            board = Switchboard()
            opened.callback(board.close)
            for row, agent in enumerate(scene.agents):
                if links is not None:
                    self.links[row] = _link(fleet, row, host, links and links + row, board, opened)
                if cameras is not None and agent.camera is not None:
                    port = cameras and cameras + len(decks)
                    shape = agent.camera.height, agent.camera.width
                    deck = AideckServer(host, port, shape=shape, jpeg=jpeg, switchboard=board)
                    opened.callback(deck.close)
                    decks[row] = deck
                    self.cameras[row] = _shown(deck.address)
            self._opened = opened.pop_all()
        for row, deck in decks.items():
            _stream(fleet, row, deck)

    def close(self) -> None:
        """Disconnect all clients and close the ports."""
        self._opened.close()


def _link(
    fleet: Fleet, row: int, host: str, port: int, board: Switchboard, opened: ExitStack
) -> str:
    """Open a link to one vehicle, and return where."""
    link = CrtpOverTcp(host, port, lambda packet: fleet.handle(row, packet), switchboard=board)
    opened.callback(link.close)
    fleet.listen(row, lambda packet: link.push(packet) if link.connected else None)
    return f"tcp://{_shown(link.address)}"


def _stream(fleet: Fleet, row: int, deck: AideckServer) -> None:
    """Stream a camera's images; while no client is connected, none are rendered."""
    fleet.watch(row, deck.publish, lambda: deck.connected)


def _shown(address: tuple[str, int]) -> str:
    host, port = address
    return f"{host}:{port}"
