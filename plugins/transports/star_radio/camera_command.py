"""Command ``star camera``: shows what a camera sees, with the tags in it, in the browser."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from hmac import compare_digest
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from secrets import token_urlsafe
from typing import Final

import cv2
import numpy as np

from star_core import Camera, Detections, Image, InputError, Registry, load
from star_core.toolkit import gray_from_mosaic, image_with_tags, suggestion
from star_radio.address import host_and_port
from star_radio.camera.ai_decks import SHAPE, CameraClient

ADDRESS: Final = re.compile(r"[A-Za-z0-9.-]+(:\d{1,5})?")
WIDTH: Final = 972  # px, of the picture on the page: three times an AI-deck's
PERIOD: Final = 0.1  # s, between two requests of the page
HOST: Final = "127.0.0.1"
POLICY: Final = "default-src 'none'; img-src 'self'; script-src 'nonce-{}'; style-src 'nonce-{}'"
PAGE: Final = """\
<!doctype html><html lang="en"><meta charset="utf-8"><title>star camera</title>
<style nonce="{nonce}">body {{ font: 16px sans-serif; margin: 1em; background: #222; color: #eee }}
img {{ max-width: 100%; display: block }}</style>
<p>Green: tags of family 36h11 with their numbers. Move the drone or the tags until they are whole
and sharp. Only one program reads a camera: stop this one with Ctrl+C before a flight.</p>
<img id="picture" alt="no image yet">
<script nonce="{nonce}">
const picture = document.getElementById("picture");
const again = (ms) => setTimeout(() => {{ picture.src = "picture?" + Date.now() }}, ms);
picture.onload = () => again({period}); picture.onerror = () => again(1000); again(0);
</script></html>
"""


def run(options: argparse.Namespace, registry: Registry) -> int:
    """Serve the page until it is interrupted, and return the exit status, 0.

    Raises:
        InputError: There is no such camera, or the port is in use.
    """
    address, camera = source(options.camera, options.mission, registry)
    host, port = host_and_port(address)
    shape = SHAPE if camera is None else (camera.height, camera.width)
    pixels = "gray" if camera is None else camera.pixels
    with CameraClient(host, port, shape=shape) as client:
        preview = Preview(client, pixels)
        with serve(preview, options.port) as server:
            sys.stdout.write(f"{server.address}\nstop with Ctrl+C\n")
            sys.stdout.flush()
            if not client.reached(options.timeout):
                sys.stderr.write(f"{client.fault}: waiting for it\n")
            try:
                server.serve_forever(poll_interval=0.2)
            except KeyboardInterrupt:
                return 0
    return 0


def configure(line: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    line.description = (
        "Show what a camera sees, with the tags in it, in the browser: for aiming. The page is "
        "served on this machine only."
    )
    line.add_argument(
        "camera", metavar="ADDRESS|NAME", help="host[:port] of an AI-deck, or an agent of --mission"
    )
    line.add_argument(
        "--mission", metavar="FILE", help="mission with transport `radio` that has the camera"
    )
    line.add_argument("--port", type=int, default=0, help="port of the page (a free one)")
    line.add_argument(
        "--timeout", type=float, default=2.0, help="s to wait for the camera (%(default)s)"
    )


def source(name: str, mission_file: str | None, registry: Registry) -> tuple[str, Camera | None]:
    """Return the address of a camera, and what the mission describes of it.

    Raises:
        InputError: There is no such camera.
    """
    if mission_file is None:
        if not ADDRESS.fullmatch(name):
            expected = "expected host[:port] of an AI-deck, or an agent with --mission FILE"
            raise InputError(f"camera {name!r}: {expected}", "invalid-argument")
        return name, None
    mission = load(mission_file, registry)
    cameras = mission.plugins["transport"].options.get("cameras", {})
    if name not in cameras:
        hint = suggestion(name, sorted(cameras), "there are")
        text = f"{mission_file}: transport.cameras has no {name!r}{hint}"
        raise InputError(text, "unknown-agent")
    agent = next(agent for agent in mission.scene.agents if agent.name == name)
    return str(cameras[name]), agent.camera


class Preview:
    """The newest image of a camera, as a picture with its tags."""

    def __init__(self, client: CameraClient, pixels: str = "gray") -> None:
        self._client, self._pixels = client, pixels
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        self._detector = cv2.aruco.ArucoDetector(family)
        self._picture: bytes | None = None

    def picture(self) -> bytes | None:
        """Return the newest image as JPEG, the last one again if none is newer, None before one."""
        if shots := self._client.arrived():
            image = gray_from_mosaic(shots[-1].image, self._pixels)
            self._picture = as_jpeg(image, self.tags(image))
        return self._picture

    def tags(self, image: Image) -> Detections:
        """Return the tags in an image, by OpenCV's detector."""
        corners, numbers, _ = self._detector.detectMarkers(image)
        n = len(corners)
        never = np.full(n, np.nan)
        # OpenCV's begin at the upper left, clockwise.
        squares = np.array(corners, np.float64).reshape(n, 4, 2)[:, [3, 2, 1, 0]]
        tags = np.zeros(0, np.int64) if n == 0 else np.asarray(numbers, np.int64).ravel()
        return Detections(np.zeros(n, np.int64), tags, squares, never, never)


def as_jpeg(image: Image, tags: Detections) -> bytes:
    """Return an image with tags as JPEG."""
    shown = image_with_tags(image, tags, WIDTH)
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(shown, cv2.COLOR_RGB2BGR))[1])


class Server(ThreadingHTTPServer):
    """Serves the page and its picture at paths that begin with a secret token."""

    daemon_threads = True

    def __init__(self, preview: Preview, port: int) -> None:
        self.token = token_urlsafe(16)
        self.picture: Callable[[], bytes | None] = preview.picture
        super().__init__((HOST, port), _Handler)

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{HOST}:{self.server_port}/{self.token}/"

    def permits(self, host: str | None, origin: str | None, path: str) -> bool:
        """Return whether a request is for this page by its own address, with its token.

        The check of the host defeats DNS rebinding, as in `star_view`'s gate.
        """
        names = {f"{name}:{self.server_port}" for name in (HOST, "localhost")}
        if host not in names or origin not in {None, *(f"http://{name}" for name in names)}:
            return False
        begin = path.encode(errors="surrogateescape")[: len(self.token) + 2]
        return compare_digest(begin, f"/{self.token}/".encode())


def serve(preview: Preview, port: int) -> Server:
    """Return a server on the loopback interface.

    Raises:
        InputError: The port is in use.
    """
    try:
        return Server(preview, port)
    except (OSError, OverflowError) as error:
        raise InputError(f"--port {port}: {error}", "invalid-argument") from error


class _Handler(BaseHTTPRequestHandler):
    server: Server
    timeout = 10.0  # s, for a request

    def do_GET(self) -> None:
        """Answer a request: the page, or its picture."""
        headers = self.headers
        if len(headers.get_all("Host") or ()) != 1 or not self.server.permits(
            headers["Host"], headers["Origin"], self.path
        ):
            self._answer(HTTPStatus.FORBIDDEN, "text/plain", b"foreign address or no token\n")
            return
        name = self.path[len(self.server.token) + 2 :].partition("?")[0]
        nonce = token_urlsafe(9)
        if name == "":
            page = PAGE.format(period=round(1000 * PERIOD), nonce=nonce)
            self._answer(HTTPStatus.OK, "text/html; charset=utf-8", page.encode(), nonce)
        elif name == "picture" and (picture := self.server.picture()) is not None:
            self._answer(HTTPStatus.OK, "image/jpeg", picture)
        else:
            self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"no image yet\n")

    def _answer(self, status: HTTPStatus, kind: str, body: bytes, nonce: str = "") -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Content-Security-Policy", POLICY.format(nonce, nonce))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_arguments: object) -> None:
        """Log nothing: requests come ten times a second."""
