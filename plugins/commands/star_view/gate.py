"""The gate of a page: which connections reach viser's server, and which of their messages.

viser accepts a websocket of any origin, and sets whatever attribute of a control a client names. A
page can land a flight and stop its motors, so the gate refuses, with HTTP 403 and before any
message is read, what does not come from the page's own address with its token, and drops every
message but two: the camera of the browser, and a value that the control itself could send.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from hmac import compare_digest
from http import HTTPStatus
from secrets import token_urlsafe
from typing import Any, Final

import msgspec
import viser
import websockets.asyncio.server as websocket_server

from star_core import PluginError

MAX_MESSAGE: Final = 64 * 1024  # bytes, of a client
MAX_CAMERA: Final = 1e6  # of any number of a camera
SCHEME: Final = "Sec-CH-Prefers-Color-Scheme"  # a request's; of Chromium, once it is asked for it
CAMERA: Final = {
    "wxyz": 4, "position": 3, "look_at": 3, "up_direction": 3, "fov": 0, "near": 0, "far": 0,
    "image_height": 0, "image_width": 0,
}  # fmt: skip
"""Fields of a camera message and their lengths; 0 is a number."""

Control = Any  # one of viser's handles, whose classes have no common base
_patching = threading.Lock()


class Gate:
    """Guards the websocket of one server.

    Args:
        host: That the page is served on.
        control: Returns the control with an identifier, or None.
        token: Of an earlier page, whose browsers may connect again; a new one by default.

    Attributes:
        token: That a connection has to present as its path.
        on_scheme: Called with whether a browser prefers dark pages, when it loads the page, if it
            says so.
    """

    def __init__(
        self, host: str, control: Callable[[str], Control | None], token: str | None = None
    ) -> None:
        self._host = host
        self._control = control
        self.token = token or token_urlsafe(16)
        self._guards = False
        self.on_scheme: Callable[[bool], None] = lambda _dark: None

    @contextmanager
    def guarding(self) -> Iterator[None]:
        """Guard the server that viser starts within.

        Raises:
            PluginError: viser did not start it as viser 1.1 does: it would be open.
        """
        with _patching:
            serve = websocket_server.serve

            def guarded(handler: Any, host: str, port: int, **options: Any) -> Any:
                self._guards = True
                options["max_size"] = MAX_MESSAGE
                options["process_request"] = self._checked(options.get("process_request"))
                return serve(self._filtered(handler), host, port, **options)

            websocket_server.serve = guarded  # type: ignore[assignment,misc]
            try:
                yield
            finally:
                websocket_server.serve = serve  # type: ignore[misc]
        if not self._guards:
            text = f"viser {viser.__version__} serves pages in a way that cannot be guarded"
            raise PluginError(f"{text}; install viser 1.1.1", "contract-broken")

    def permits(self, request: Any, port: int, *, handshake: bool) -> bool:
        """Return whether a request is for this page by its own address, a handshake with its token.

        The check of the host defeats DNS rebinding: a foreign page whose name resolves to this
        machine sends its own name.
        """
        names = {f"{name}:{port}" for name in (self._host, "localhost")}
        hosts = request.headers.get_all("Host")
        if len(hosts) != 1 or hosts[0] not in names:
            return False
        origins = set(request.headers.get_all("Origin"))  # none if it is not from a browser
        if not origins <= {f"http://{name}" for name in names}:
            return False
        path = request.path.encode(errors="surrogateescape")
        return not handshake or compare_digest(path, b"/" + self.token.encode())

    def _checked(self, process_request: Any) -> Callable[[Any, Any], Any]:
        def check(connection: Any, request: Any) -> Any:
            port = connection.local_address[1]
            if not self.permits(request, port, handshake=False):
                return connection.respond(HTTPStatus.FORBIDDEN, "foreign address\n")
            response = None if process_request is None else process_request(connection, request)
            if response is None and not self.permits(request, port, handshake=True):
                return connection.respond(HTTPStatus.FORBIDDEN, "no token\n")
            if response is not None:
                response.headers["Accept-CH"] = response.headers["Critical-CH"] = SCHEME
                if scheme := request.headers.get(SCHEME):
                    self.on_scheme(scheme.strip('"') == "dark")
            return response

        return check

    def _filtered(self, handler: Callable[[Any], Awaitable[None]]) -> Any:
        async def handle(connection: Any) -> None:
            receive = connection.recv

            async def receive_permitted(*arguments: Any, **options: Any) -> bytes:
                while not self.reads(data := await receive(*arguments, **options)):
                    pass
                return bytes(data)

            connection.recv = receive_permitted
            await handler(connection)

        return handle

    def reads(self, data: object) -> bool:
        """Return whether a client's message is one that viser may read."""
        try:
            message = msgspec.msgpack.decode(data) if isinstance(data, bytes) else None
        except (msgspec.DecodeError, RecursionError, ValueError):
            return False
        match message:
            case {"type": "ViewerCameraMessage", **fields}:
                return fields.keys() == CAMERA.keys() and all(
                    _is_numbers(fields[name], length) for name, length in CAMERA.items()
                )
            case {"type": "GuiUpdateMessage", "uuid": str(uuid), "updates": dict(updates), **more}:
                if more or updates.keys() != {"value"}:
                    return False
                control = self._control(uuid)
                return control is not None and _could_send(control, updates["value"])
        return False


def _is_numbers(value: object, length: int) -> bool:
    """Return whether a value is so many finite numbers; with length 0, one number."""
    if length == 0:
        return _is_number(value)
    return isinstance(value, list) and len(value) == length and all(map(_is_number, value))


def _is_number(value: object) -> bool:
    return type(value) in {int, float} and abs(value) <= MAX_CAMERA  # type: ignore[arg-type]


def _could_send(control: Control, value: object) -> bool:
    """Return whether the control could send a value: a click, a switch, a choice, a number."""
    if control.disabled or not control.visible:
        return False
    match control:
        case viser.GuiButtonHandle():
            return value is True
        case viser.GuiCheckboxHandle():
            return isinstance(value, bool)
        case viser.GuiDropdownHandle() | viser.GuiButtonGroupHandle():
            return isinstance(value, str) and value in control.options
        case viser.GuiSliderHandle():
            number = value if type(value) in {int, float} else math.nan
            return bool(control.min <= number <= control.max)  # type: ignore[operator]
    return False
