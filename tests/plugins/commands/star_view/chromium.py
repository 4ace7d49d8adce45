"""A page in headless Chromium, by its DevTools protocol."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from base64 import b64decode
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any, Self
from urllib.request import urlopen

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium")
PATIENCE = 120.0  # s
ARGUMENTS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
             "--no-first-run", "--remote-debugging-port=0", "about:blank")  # fmt: skip


class Chromium:
    """A tab of a browser, at an address.

    Args:
        address: Of the page.
        arguments: Further ones of Chromium.
    """

    def __init__(self, address: str, *arguments: str) -> None:
        assert CHROMIUM is not None
        self._folder = TemporaryDirectory(ignore_cleanup_errors=True)
        profile = Path(self._folder.name)
        self._process = subprocess.Popen(
            [CHROMIUM, f"--user-data-dir={profile}", *arguments, *ARGUMENTS],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self._number = 0
        deadline = time.monotonic() + PATIENCE
        while not (port := _first_line(profile / "DevToolsActivePort")):
            assert time.monotonic() < deadline, "Chromium does not start"
            time.sleep(0.1)
        with urlopen(f"http://127.0.0.1:{port}/json/list", timeout=PATIENCE) as answer:
            tab = next(tab for tab in json.load(answer) if tab["type"] == "page")
        self._socket = connect(tab["webSocketDebuggerUrl"], max_size=None, compression=None)
        self._call("Page.navigate", url=address)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        with suppress(WebSocketException, OSError):
            self._call("Browser.close")
        self._process.wait(PATIENCE)
        self._socket.close()
        self._folder.cleanup()

    def run(self, script: str) -> Any:
        """Return the value of an expression on the page."""
        result = self._call("Runtime.evaluate", expression=script, returnByValue=True)["result"]
        return result["result"].get("value")

    def wait_for(self, script: str) -> None:
        """Wait until an expression is true."""
        deadline = time.monotonic() + PATIENCE
        while True:
            with suppress(KeyError):  # between two pages nothing can be evaluated
                if self.run(script):
                    return
            assert time.monotonic() < deadline, self.run("document.body.innerText")
            time.sleep(0.1)

    def screenshot(self, width: int = 1400, height: int = 900) -> bytes:
        """Return what the page shows, as PNG."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._call("Emulation.setDeviceMetricsOverride", **size)
        return b64decode(self._call("Page.captureScreenshot")["result"]["data"])

    def pdf(self) -> bytes:
        """Return the page as it is printed on paper."""
        return b64decode(self._call("Page.printToPDF")["result"]["data"])

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        request = {"id": self._number, "method": method, "params": parameters}
        self._socket.send(json.dumps(request))
        while (answer := json.loads(self._socket.recv(PATIENCE))).get("id") != self._number:
            pass
        return dict(answer)


def _first_line(file: Path) -> str:
    return file.read_text().partition("\n")[0] if file.exists() else ""
