"""What a view costs a flight, and how fast its page shows a picture.

``python benchmarks/view.py`` prints a table, with ``--json`` one JSON object. Ten drones fly in
real time without a view, with a reader of its page that draws nothing and, with ``--chromium``,
with the page in headless Chromium; the rounds alternate. The overrun of a tick is the time at which
its observers have returned, after its time by the clock of the flight, less that of the earliest
tick of the flight. The thread that flies has real-time priority, if that is allowed, and no other
thread or process has: what else the machine does is not counted, what the view does is.

With ``--chromium`` the page of three drones is loaded, too: time from its address until a picture
in which all three drones can be seen, with every request checked to stay on this machine. It needs
``pip install playwright``, and a Chromium at /usr/bin/chromium or $CHROMIUM. Chromium draws by the
processor, at high priority where the first picture is timed; a desktop has a graphics card.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from circle import write
from printed import command_line, show

from star_core import Flight, Registry, Tick, fly, hookimpl, load
from star_core.discovery import Source
from star_view.live_view import LiveView

ROOT = Path(__file__).parents[1]
FIRST_FLIGHT = ROOT / "missions" / "first_flight.yaml"
PICTURE = "first picture of three drones (s)"
GOAL_OVERRUN = 5.0  # ms, 99th percentile
GOAL_PICTURE = 3.0  # s
AGENTS = 10
RADIUS = 2.5  # m, of the circle that they change sides on
TRANSPORT = "{use: sim, profile: ideal, controller: ideal}"
SPEED = 1.0  # of the clock, by that of real time
PATIENCE = 60.0  # s
HUES = (101, 11, 82)  # of 180: blue, orange and green, those of the drones
SCENE = 880  # px, width of the page less its panel
NEAR, VIVID, ENOUGH = 6, 150, 20  # hue, saturation of 255, pixels
ROUNDS = 3
PORT = 18300
CHROMIUM = "/usr/bin/chromium"
ARGUMENTS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
             "--enable-unsafe-swiftshader")  # fmt: skip


@contextmanager
def real_time_priority() -> Iterator[None]:
    """Give this thread real-time priority, if that is allowed, but none that it starts."""
    before = os.sched_getscheduler(0)
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(1))
    try:
        yield
    finally:
        with suppress(OSError):
            os.sched_setscheduler(0, before, os.sched_param(0))


class Overruns:
    """Notes when each tick is over; registered before all others, it is called last."""

    def __init__(self) -> None:
        self.overruns: list[float] = []  # s, from an unknown origin

    @hookimpl(trylast=True)
    def star_ticked(self, tick: Tick) -> None:
        self.overruns.append(time.monotonic() - tick.time / SPEED)


def overruns(mission: Path, view: LiveView | None, reader: Any = None) -> list[float]:
    """Fly in real time, watched or not, and return the overrun of every tick, s."""
    clock = Overruns()
    registry = Registry(clock)
    if view is not None:
        registry.add(view, Source("star-swarm:view:view"))
    if reader is not None:
        registry.add(Opener(view, reader), Source("benchmark:opener"))
    summary = fly(load(mission, registry, [f"transport.speed={SPEED}"]), registry)
    if failed := [event["text"] for event in summary["events"] if event["kind"] == "observer"]:
        sys.exit("\n".join(failed))
    earliest = min(clock.overruns)
    return [overrun - earliest for overrun in clock.overruns]


class Opener:
    """Opens the page before the flight begins, in another process, until the flight ends."""

    def __init__(self, view: LiveView | None, target: Any) -> None:
        self._view, self._target = view, target

    @hookimpl(trylast=True)
    def star_mission_started(self, flight: Flight) -> None:
        assert self._view is not None
        assert self._view.address
        context = multiprocessing.get_context("spawn")
        self._ready, self._done = context.Event(), context.Event()
        arguments = (self._view.address, self._ready, self._done)
        self._process = context.Process(target=self._target, args=arguments)
        self._process.start()
        assert self._ready.wait(2 * PATIENCE)

    @hookimpl(tryfirst=True)
    def star_mission_ended(self) -> None:
        self._done.set()
        self._process.join(30)


def read_page(address: str, ready: Any, done: Any) -> None:
    """Receive everything that a page sends, as fast as it comes."""
    import viser
    from websockets.asyncio.client import connect
    from websockets.exceptions import ConnectionClosed
    from websockets.typing import Subprotocol

    async def read() -> None:
        protocol = Subprotocol(f"viser-v{viser.__version__}")
        async with connect(
            address.partition("websocket=")[2],
            subprotocols=[protocol],
            compression=None,
            max_size=None,
        ) as socket:
            ready.set()
            while not done.is_set():
                try:
                    await asyncio.wait_for(socket.recv(), 1)
                except TimeoutError:
                    continue
                except ConnectionClosed:
                    return

    asyncio.run(read())


def browse(address: str, ready: Any, done: Any) -> None:
    """Show a page in Chromium."""
    with browser_page(nice=0) as page:
        page.goto(address)
        page.wait_for_selector("canvas", timeout=PATIENCE * 1e3)
        page.wait_for_timeout(3000)
        ready.set()
        while not done.is_set():
            page.wait_for_timeout(200)


@contextmanager
def browser_page(nice: int) -> Iterator[Any]:
    """Yield a new page of Chromium, whose processes have a niceness, if that is allowed."""
    from playwright.sync_api import sync_playwright

    path = os.environ.get("CHROMIUM", CHROMIUM)
    with sync_playwright() as playwright, TemporaryDirectory() as folder:
        start = Path(folder) / "chromium"
        group = "/proc/self/autogroup"  # Linux shares the processor among sessions first
        start.write_text(
            f'#!/bin/sh\necho {nice} 2>/dev/null >{group}\nexec nice -n {nice} {path} "$@"\n'
        )
        start.chmod(0o755)
        browser = playwright.chromium.launch(executable_path=start, args=[*ARGUMENTS])
        yield browser.new_page()  # of 1280 x 720 px
        browser.close()


def first_picture() -> dict[str, float]:
    """Load the page of three drones; return the time until its first picture and its requests."""
    from star_view.command import simulate
    from star_view.replay import Replay

    mission = load(FIRST_FLIGHT, registry := Registry())
    replay = Replay(simulate(mission, registry), 0.3, port=PORT)
    requests: list[str] = []
    try:
        with browser_page(nice=-15) as page:  # it is open already
            page.on("request", lambda request: requests.append(request.url))
            page.on("websocket", lambda socket: requests.append(socket.url))
            begun = time.monotonic()
            page.goto(replay.server.address, wait_until="commit")
            page.get_by_text("cf3").first.wait_for(timeout=PATIENCE * 1e3)  # its row in the panel
            while not shows_drones(page.screenshot()):
                assert time.monotonic() - begun < PATIENCE
            took = time.monotonic() - begun
            page.wait_for_timeout(3000)
    finally:
        replay.server.close()
    own = (f"http://127.0.0.1:{PORT}", f"ws://127.0.0.1:{PORT}", "data:", "blob:")
    external = [url for url in requests if not url.startswith(own)]
    assert not external, external
    return {
        PICTURE: took,
        "requests of the page": float(len(requests)),
        "of them to elsewhere": float(len(external)),
    }


def shows_drones(png: bytes) -> bool:
    """Return whether a screenshot has pixels of the colors of three drones."""
    import cv2

    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    hues, saturation, _ = cv2.split(cv2.cvtColor(image[:, :SCENE], cv2.COLOR_BGR2HSV))
    vivid = hues[saturation > VIVID].astype(int)
    return all((np.abs(vivid - hue) <= NEAR).sum() >= ENOUGH for hue in HUES)


def percentiles(values: Sequence[float]) -> tuple[float, float]:
    """Return the median and the 99th percentile, ms."""
    low, high = np.percentile(np.array(values) * 1e3, [50, 99])
    return float(low), float(high)


def measure(rounds: int, *, chromium: bool) -> dict[str, float]:
    """Return the figures by name."""
    ways: dict[str, list[float]] = {"no view": [], "view and reader": []}
    if chromium:
        ways["view and Chromium"] = []
    with TemporaryDirectory() as folder:
        mission = write(Path(folder), AGENTS, RADIUS, TRANSPORT, turns=1)
        fly(load(mission, registry := Registry()), registry)  # kernels are compiled once
        for _ in range(rounds):
            for way, values in ways.items():
                view = None if way == "no view" else LiveView(0.3, port=PORT + 1)
                reader = {"view and reader": read_page, "view and Chromium": browse}.get(way)
                values.extend(overruns(mission, view, reader))
    figures: dict[str, float] = {}
    for way, values in ways.items():
        middle, high = percentiles(values)
        figures |= {f"{way}: overrun, median (ms)": middle, f"{way}: overrun, p99 (ms)": high}
    return figures | (first_picture() if chromium else {})


def main() -> None:
    """Print the figures."""
    line = command_line(__doc__, rounds=ROUNDS)
    line.add_argument("--chromium", action="store_true", help="also with Chromium (playwright)")
    options = line.parse_args()
    with real_time_priority():
        figures = measure(options.rounds, chromium=options.chromium)
    goals = {PICTURE: GOAL_PICTURE} | {name: GOAL_OVERRUN for name in figures if "p99" in name}
    show(figures, as_json=options.json, goals=goals)


if __name__ == "__main__":
    main()
