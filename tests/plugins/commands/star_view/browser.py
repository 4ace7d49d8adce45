"""A browser's side of viser's protocol: what a page shows, and an operator's input."""

from __future__ import annotations

import time
from html import unescape
from types import TracebackType
from typing import Any, Self
from urllib.parse import parse_qs, urlsplit

import msgspec
import viser
import zstandard
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from star_view.markdown import BREAK

PATIENCE = 120.0  # s: kernels may be compiled first
CAMERA = {
    "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, 0.0, 3.0), "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0), "fov": 1.0, "near": 0.1, "far": 100.0,
    "image_height": 600, "image_width": 800,
}  # fmt: skip


class Browser:
    """A connection to a page, which is read only while something is waited for.

    Args:
        address: Of the page.
        camera: Fields of its camera that are not those of `CAMERA`.

    Attributes:
        controls: Messages that added the controls of the panel, by label.
        texts: Newest content of each text of the panel, by identifier, as it is shown.
        markdown: The same as it was sent.
        nodes: Names of the objects of the scene; ``visible: NAME`` once it was made visible.
    """

    def __init__(self, address: str, **camera: Any) -> None:
        self._socket = connect(
            parse_qs(urlsplit(address).query)["websocket"][0],
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            compression=None,
            max_size=None,
        )
        self.send(
            "ViewerCameraMessage", **(CAMERA | camera)
        )  # a browser that shows nothing has no say
        self.controls: dict[str, dict[str, Any]] = {}
        self.texts: dict[str, str] = {}
        self.markdown: dict[str, str] = {}
        self.nodes: set[str] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        self._socket.close()

    def wait_for(self, text: str) -> None:
        """Read until the panel shows a text, or the scene has an object of that name."""
        deadline = time.monotonic() + PATIENCE
        while not (
            text in self.nodes
            or any(text in shown for shown in [*self.texts.values(), *self.controls])
        ):
            assert time.monotonic() < deadline, f"no {text!r} in {self.texts} {[*self.controls]}"
            self._read()

    def set(self, label: str, value: Any) -> None:
        """Use a control: press a button (True), move a slider."""
        self.wait_for(label)
        uuid = self.controls[label]["uuid"]
        self.send("GuiUpdateMessage", uuid=uuid, updates={"value": value})

    def send(self, kind: str, **fields: Any) -> None:
        """Send a message, which need not be one that a browser sends."""
        self._socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def _read(self) -> None:
        data = self._socket.recv(PATIENCE)
        assert isinstance(data, bytes)
        size = int.from_bytes(data[8:16], "little")
        inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])
        for message in msgspec.msgpack.decode(inner)["messages"]:
            properties = message.get("props") or message.get("updates") or {}
            if isinstance(label := properties.get("label"), str):
                self.controls[label] = message
            for key in "_markdown", "content", "body":
                if key in properties:
                    self.markdown[message["uuid"]] = str(properties[key])
                    shown = unescape(str(properties[key])).replace(BREAK, "")
                    self.texts[message["uuid"]] = shown
            if "name" in message:
                self.nodes.add(message["name"])
            if message["type"] == "SetSceneNodeVisibilityMessage" and message["visible"]:
                self.nodes.add(f"visible: {message['name']}")
