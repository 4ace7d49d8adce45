"""Attacks on the page of a flight: by its texts, by foreign connections, by messages of clients."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from http.client import HTTPConnection
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pytest
import websockets.asyncio.server as websocket_server
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from star_core import Event, PluginError, Registry, fly, load, read_run

viser = pytest.importorskip("viser")

from star_view.gate import MAX_MESSAGE, Gate  # noqa: E402 -- they import viser
from star_view.live_page import LivePage  # noqa: E402
from star_view.messages import Watched  # noqa: E402
from star_view.plan_scene import PlannedStep, add_plan  # noqa: E402
from star_view.replay import Replay  # noqa: E402
from tests.conftest import HOP, ROOM  # noqa: E402
from tests.plugins.commands.star_view.browser import CAMERA, Browser  # noqa: E402
from tests.plugins.commands.star_view.chromium import CHROMIUM, Chromium  # noqa: E402
from tests.waiting import eventually, free_port  # noqa: E402

PRESS = "[...parent.document.querySelectorAll('button')].map(b=>b.click())"
ATTACK = f'<iframe srcdoc="&lt;script&gt;{PRESS}&lt;&#47;script&gt;"></iframe>'
FILE = ATTACK.replace("</iframe>", "") + ".yaml"  # a slash cannot be in a name
ADDRESSES = (
    "(https://foreign.example) Http://foreign.example WWW.foreign.example a@foreign.example "
)
ADDRESSES += "x" * 80
STEPS = """\
mission:
  - takeoff: {height: 0.3}
  - include: {file: FILE}
  - external: {agents: cf1, port: PORT, timeout: 20, lockstep: true}
"""


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Record of a flight whose step file has a hostile name; an `external` client adds a reason."""
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "room.yaml").write_text(ROOM)
    (folder / FILE).write_text("star: 1\nmission:\n  - hold: {for: 0.1}\n")
    port = free_port()
    steps = STEPS.replace("FILE", json.dumps(FILE)).replace("PORT", str(port))
    (folder / "mission.yaml").write_text(HOP.partition("mission:")[0] + steps)
    threading.Thread(target=_fail, args=(port,), daemon=True).start()
    registry = Registry()
    fly(load(folder / "mission.yaml", registry), registry, folder=folder / "run")
    return read_run(folder / "run")


def _fail(port: int) -> None:
    """Fail the `external` step, with a hostile reason."""
    while True:
        try:
            with socket.create_connection(("127.0.0.1", port), timeout=60) as client:
                client.sendall(json.dumps({"fail": ATTACK}).encode() + b"\n")
                client.recv(1 << 20)
                return
        except ConnectionRefusedError:
            time.sleep(0.02)


@pytest.fixture
def commands() -> list[dict[str, Any]]:
    """What the page sends to the flight, beside that a browser is connected."""
    return []


@pytest.fixture
def page(hostile: Any, commands: list[dict[str, Any]]) -> Iterator[LivePage]:
    def send(**command: Any) -> None:
        if "connected" not in command:
            commands.append(command)

    live = LivePage(Watched("hostile", hostile.world, hostile.swarm, 0.2, 1.0, 18400), send)
    yield live
    live.server.close()


def test_hostile_texts_are_shown_as_text(
    hostile: Any, page: LivePage, commands: list[dict[str, Any]]
) -> None:
    texts = [event["text"] for event in hostile.summary["events"]]
    assert any(FILE in text for text in texts)
    assert ATTACK in hostile.summary["reason"]
    page._events.extend(Event(0.0, "step", text) for text in texts)
    page._log.content = page._log_text()
    page.end(hostile.summary)
    add_plan(page.server, (), [PlannedStep(f"hold {ATTACK}", "hold", {})])
    with Browser(page.server.address) as browser:
        browser.wait_for(ATTACK)
        browser.wait_for(FILE)
        browser.wait_for(f"hold {ATTACK}")
        assert "<" not in str(browser.markdown)
    replay = Replay(hostile, None, port=18410)
    try:
        with Browser(replay.server.address) as browser:
            browser.wait_for(ATTACK)
            assert "<" not in str(browser.markdown)
    finally:
        replay.server.close()
    assert commands == []


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_in_chromium_texts_have_no_links(page: LivePage) -> None:
    page._events.append(Event(0.0, "step", ADDRESSES))
    page._log.content = page._log_text()
    page.end({"outcome": "failed", "reason": ADDRESSES})
    with Chromium(page.server.address) as chromium:
        shown = "document.body.innerText.replaceAll('\\u200b', '')"
        chromium.wait_for(f"{shown}.split({json.dumps(ADDRESSES)}).length == 3")
        assert chromium.run("document.querySelectorAll('a').length") == 0
        wide = "[...document.querySelectorAll('li')].some(li => li.scrollWidth > li.clientWidth)"
        assert chromium.run(wide) is False


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_in_chromium_only_the_operator_presses(
    hostile: Any, page: LivePage, commands: list[dict[str, Any]]
) -> None:
    texts = [event["text"] for event in hostile.summary["events"]]
    page._events.extend(Event(0.0, "step", text) for text in [*texts, hostile.summary["reason"]])
    page._log.content = page._log_text()
    with Chromium(page.server.address) as chromium:
        chromium.wait_for("document.body.innerText.includes('<iframe srcdoc=')")
        assert chromium.run("document.querySelectorAll('iframe').length") == 0
        assert commands == []
        chromium.run(
            "[...document.querySelectorAll('button')]"
            ".find(b => b.innerText.includes('land all')).click()"
        )
        assert eventually(lambda: commands)
    assert commands == [{"land_all": True}]


def connected(address: str, **headers: Any) -> Any:
    protocol = Subprotocol(f"viser-v{viser.__version__}")
    return connect(address, subprotocols=[protocol], compression=None, max_size=None, **headers)


def test_foreign_connections_are_refused(page: LivePage) -> None:
    whole = page.server.address.partition("websocket=")[2]
    host = urlsplit(whole).netloc
    port = host.partition(":")[2]
    own = Origin(f"http://{host}")
    rebound = {"Host": f"rebound.example:{port}"}
    refusals: list[tuple[str, dict[str, Any]]] = [
        (f"ws://{host}", {"origin": own}),
        (f"ws://{host}/", {}),
        (f"{whole}x", {"origin": own}),
        (whole[:-1], {"origin": own}),
        (f"ws://{host}/%C3%A9", {"origin": own}),
        (whole, {"origin": Origin("http://foreign.example")}),
        (whole, {"origin": Origin("http://127.0.0.1:1")}),
        (whole, {"origin": Origin("null")}),
        (whole, {"additional_headers": rebound}),
    ]
    for address, headers in refusals:
        with pytest.raises(InvalidStatus) as refused, connected(address, **headers):
            pass
        assert refused.value.response.status_code == 403, (address, headers)
    for origin in own, Origin(f"http://localhost:{port}"), None:
        with connected(whole, origin=origin) as client:
            assert client.recv(30)


def test_dns_rebinding_does_not_load_the_page(page: LivePage) -> None:
    port = page.server.get_port()
    for host, status in [
        (f"127.0.0.1:{port}", 200),
        (f"localhost:{port}", 200),
        (f"rebound.example:{port}", 403),
        ("127.0.0.1", 403),
    ]:
        client = HTTPConnection("127.0.0.1", port, timeout=30)
        client.request("GET", "/", headers={"Host": host})
        assert client.getresponse().status == status, host
        client.close()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_in_chromium_a_rebound_name_reaches_nothing(page: LivePage) -> None:
    port, address = page.server.get_port(), page.server.address
    websocket = address.partition("websocket=")[2]
    rebound = f"http://rebound.example:{port}"
    with Chromium(rebound, "--host-resolver-rules=MAP rebound.example 127.0.0.1") as chromium:
        chromium.wait_for("document.body.innerText.includes('foreign address')")
        assert chromium.run("origin") == rebound
        chromium.run(
            "window.tried = [];"
            "fetch('/').then(answer => tried.push(answer.status));"
            f"for (const address of ['ws://' + location.host, {websocket!r}]) {{"
            "  const socket = new WebSocket(address);"
            "  socket.onopen = () => tried.push('open');"
            "  socket.onerror = () => tried.push('refused');"
            "}"
        )
        chromium.wait_for("tried.length == 3")
        assert chromium.run("tried.sort()") == [403, "refused", "refused"]


HOSTILE_UPDATES: list[dict[str, Any]] = [
    {"update_cb": []},
    {"value": True, "update_cb": []},
    {"sync_cb": None},
    {"removed": True},
    {"is_button": False},
    {"props": None},
    {"value": []},
    {"value": "x" * 1000},
    {"value": None},
    {},
]
HOSTILE_MESSAGES: list[dict[str, Any]] = [
    {"type": "ShareUrlRequest"},
    {"type": "NoSuchMessage"},
    {"type": "GuiCloseModalMessage", "uuid": "x"},
    {"type": "FileTransferStartUpload", "source_component_uuid": "x", "transfer_uuid": "y",
     "filename": "z", "mime_type": "", "part_count": 1, "size_bytes": 1},
    {"type": "ViewerCameraMessage", **CAMERA, "fov": "wide"},
    {"type": "ViewerCameraMessage", **CAMERA, "fov": float("nan")},
    {"type": "ViewerCameraMessage", **CAMERA, "wxyz": [1e300] * 4},
    {"type": "ViewerCameraMessage", **CAMERA, "position": [0.0]},
    {"type": "ViewerCameraMessage"},
    {"type": 7},
    {},
]  # fmt: skip


def test_hostile_messages_change_nothing(page: LivePage, commands: list[dict[str, Any]]) -> None:
    with Browser(page.server.address) as hostile, Browser(page.server.address) as operator:
        for browser in hostile, operator:
            browser.wait_for("speed")
        controls = {label: hostile.controls[label]["uuid"] for label in ("land all", "speed")}
        for updates in HOSTILE_UPDATES:
            for uuid in [*controls.values(), "no such control"]:
                hostile.send("GuiUpdateMessage", uuid=uuid, updates=updates)
        for speed in -1.0, 0.0, 1e308, float("nan"), float("inf"), True, "9":
            hostile.send("GuiUpdateMessage", uuid=controls["speed"], updates={"value": speed})
        for message in HOSTILE_MESSAGES:
            hostile._socket.send(msgspec.msgpack.encode(message))
        for data in b"", b"\xc1", b"\x91" * 5000, "text":
            hostile._socket.send(data)
        hostile.set("speed", value=2.0)  # in order: all before it were read
        assert eventually(lambda: len(commands) >= 1)
        operator.set("land all", value=True)
        operator.set("stop motors", value=True)
        assert eventually(lambda: len(commands) >= 3)
    assert commands == [{"speed": 2.0}, {"land_all": True}, {"stop_motors": True}]


def test_oversized_messages_end_their_connection(
    page: LivePage, commands: list[dict[str, Any]]
) -> None:
    with Browser(page.server.address) as hostile:
        hostile._socket.send(bytes(MAX_MESSAGE + 1))
        with pytest.raises(ConnectionClosed):
            _read_on(hostile)
    with Browser(page.server.address) as operator:
        operator.set("land all", value=True)
        assert eventually(lambda: len(commands) >= 1)


def _read_on(browser: Browser) -> None:
    while True:
        browser._socket.recv(30)


def test_disabled_controls_take_no_value(
    hostile: Any, page: LivePage, commands: list[dict[str, Any]]
) -> None:
    with Browser(page.server.address) as browser:
        browser.wait_for("land all")
        page.end(hostile.summary)
        browser.set("land all", value=True)
        page.speed.disabled = False
        browser.set("speed", value=3.0)
        assert eventually(lambda: len(commands) >= 1)
    assert commands == [{"speed": 3.0}]


def test_a_server_that_cannot_be_guarded_is_refused() -> None:
    serve = websocket_server.serve
    with (
        pytest.raises(PluginError),
        Gate("127.0.0.1", lambda _uuid: None).guarding(),
    ):
        pass
    assert websocket_server.serve is serve


def test_hostile_replays_keep_their_values(hostile: Any) -> None:
    replay = Replay(hostile, None, port=18420)
    try:
        with Browser(replay.server.address) as browser:
            browser.wait_for("time (s)")
            uuid = browser.controls["time (s)"]["uuid"]
            for value in (1e9, -1.0, float("nan")):
                browser.send("GuiUpdateMessage", uuid=uuid, updates={"value": value})
            browser.send("GuiUpdateMessage", uuid=uuid, updates={"update_cb": []})
            browser.set("time (s)", value=1.0)
            assert eventually(lambda: replay.timeline.value == 1.0)
            assert np.isfinite(replay.timeline.value)
            browser.wait_for("**1.00 s**")
    finally:
        replay.server.close()
