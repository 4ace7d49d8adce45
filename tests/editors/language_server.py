"""A language server as an editor talks to it: JSON-RPC with headers, over its standard streams."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from threading import Timer
from types import TracebackType
from typing import Any, Final, Self

PATIENCE: Final = 300.0  # s after which a server that does not answer is stopped


class LanguageServer:
    """A running server.

    Args:
        command: That starts it.
        settings: What it is told when it asks for a section of the configuration.
    """

    def __init__(self, command: Sequence[str], settings: Mapping[str, Any]) -> None:
        self._settings = settings
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._watchdog = Timer(PATIENCE, self._process.kill)
        self._watchdog.start()
        self._last = 0
        self._version = 0
        self._found: dict[str, list[dict[str, Any]]] = {}

    def __enter__(self) -> Self:
        capabilities = {
            "workspace": {"configuration": True},
            "textDocument": {
                "completion": {"completionItem": {"snippetSupport": True}},
                "hover": {"contentFormat": ["markdown"]},
            },
        }
        self.ask("initialize", {"processId": None, "rootUri": None, "capabilities": capabilities})
        self.tell("initialized", {})
        self.tell("workspace/didChangeConfiguration", {"settings": self._settings})
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._watchdog.cancel()
        self._process.kill()
        self._process.communicate()

    def open(self, path: Path, text: str) -> list[dict[str, Any]]:
        """Open a file that has this text, whatever is on the disk; return what is wrong with it."""
        uri = path.as_uri()
        self._version += 1
        item = {"uri": uri, "languageId": "yaml", "version": self._version, "text": text}
        self._found.pop(uri, None)
        self.tell("textDocument/didOpen", {"textDocument": item})
        while uri not in self._found:
            self._take()
        return self._found[uri]

    def close(self, path: Path) -> None:
        """Close a file."""
        self.tell("textDocument/didClose", {"textDocument": {"uri": path.as_uri()}})

    def complete(self, path: Path, line: int, character: int) -> list[dict[str, Any]]:
        """Return what may stand at a place, counted from 0."""
        completion = self.ask("textDocument/completion", _at(path, line, character))
        items: list[dict[str, Any]] = (
            completion["items"] if isinstance(completion, dict) else completion or []
        )
        return items

    def hover(self, path: Path, line: int, character: int) -> str:
        """Return what is shown for what stands at a place, counted from 0."""
        answer = self.ask("textDocument/hover", _at(path, line, character))
        return "" if answer is None else str(answer["contents"]["value"])

    def ask(self, method: str, parameters: Mapping[str, Any]) -> Any:
        """Return the answer to a request.

        Raises:
            RuntimeError: It is an error.
        """
        self._last += 1
        asked = self._last
        self._send({"id": asked, "method": method, "params": parameters})
        while True:
            message = self._take()
            if message.get("id") == asked and "method" not in message:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                return message["result"]

    def tell(self, method: str, parameters: Mapping[str, Any]) -> None:
        """Send what wants no answer."""
        self._send({"method": method, "params": parameters})

    def _take(self) -> dict[str, Any]:
        """Take the next message, and answer it if it is a request of the server's own."""
        stream = self._process.stdout
        assert stream is not None
        length = 0
        while line := stream.readline().strip():
            name, _, value = line.partition(b":")
            length = int(value) if name.lower() == b"content-length" else length
        if not length:
            raise RuntimeError("the language server ended")
        message: dict[str, Any] = json.loads(stream.read(length))
        method = message.get("method")
        if method == "textDocument/publishDiagnostics":
            self._found[message["params"]["uri"]] = message["params"]["diagnostics"]
        elif method is not None and "id" in message:
            self._send({"id": message["id"], "result": self._answer(message)})
        return message

    def _answer(self, message: Mapping[str, Any]) -> Any:
        if message["method"] != "workspace/configuration":
            return None
        return [self._settings.get(item.get("section")) for item in message["params"]["items"]]

    def _send(self, message: Mapping[str, Any]) -> None:
        stream = self._process.stdin
        assert stream is not None
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        stream.write(b"Content-Length: %d\r\n\r\n%b" % (len(body), body))
        stream.flush()


def _at(path: Path, line: int, character: int) -> dict[str, Any]:
    return {
        "textDocument": {"uri": path.as_uri()},
        "position": {"line": line, "character": character},
    }
