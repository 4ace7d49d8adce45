"""How long a swarm takes to connect, and how late its setpoints are, over UDP to ``star fleet``.

``python benchmarks/radio.py`` prints a table, with ``--json`` one JSON object. The fleet runs in a
process of its own. The peer is cflib's own ``Swarm.open_links`` to the same drones, interleaved
with ours; ours also starts the estimators anew, waits half a second until they have settled, and
then for the first report. A setpoint is late from when its tick is due until the datagrams of all
drones are sent, while every drone reports every 10 ms; its peer is a loop that only sleeps, in a
process of its own at the same time, so that other programs slow both down. What of that time
the processor spent on it (``processor``) does not depend on that, nor does the share of a processor
that the whole transport takes.
"""

from __future__ import annotations

import dataclasses
import logging
import multiprocessing
import statistics
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cflib.crtp
import numpy as np
from cflib.crazyflie.swarm import CachedCfFactory, Swarm
from printed import command_line, show

import star_radio
from star_core import PluginError, Scene, Setpoint
from star_core.plugin_support.option_schema import fill_defaults
from star_core.testing import scene
from star_radio.options import OPTIONS
from star_sim import ideal_world

MANY, FEW = 30, 10  # drones to connect, drones to steer
ROUNDS = 3
TICKS = 600  # half a minute at 20 Hz
GUARDIAN = True  # whether it has the links in a process of its own, the default
HANGS = 20.0  # s
DEAD = "udp://127.0.0.1:9"  # no drone answers there


def serve(n: int, pipe: Connection) -> None:
    """Serve `n` drones until something is received; runs in a process of its own."""
    from star_fleet.server import Fleet

    with Fleet(scene(n), port=0, **ideal_world(noise=False, speed=1.0)) as fleet:
        pipe.send(fleet.addresses)
        pipe.recv()


class Drones:
    """A fleet in another process, and the scene that reaches it."""

    def __init__(self, n: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(n, theirs), daemon=True)
        self._process.start()
        self.uris: list[str] = self._pipe.recv()

    def scene(self, *, dead: int = 0) -> Scene:
        """Their scene; the last `dead` of them have an address without a drone."""
        uris = self.uris[: len(self.uris) - dead] + [DEAD] * dead
        room = scene(len(uris))
        agents = (
            dataclasses.replace(agent, uri=uri)
            for agent, uri in zip(room.agents, uris, strict=True)
        )
        return dataclasses.replace(room, agents=tuple(agents), realtime=True)

    def close(self) -> None:
        """End the process."""
        self._pipe.send("end")
        self._process.join()


def connected(room: Scene, cache: Path, **options: Any) -> tuple[float, str]:
    """Return how long it takes to connect, s, and why it fails."""
    own = {"cache": str(cache), "guardian": GUARDIAN}
    radio = star_radio.make(room, **fill_defaults(own | options, OPTIONS))
    begun = time.perf_counter()
    failure = ""
    try:
        radio.connect()
    except PluginError as error:
        failure = str(error)
    took = time.perf_counter() - begun
    radio.close()
    return took, failure


def connected_by_cflib(uris: list[str], cache: Path) -> float:
    """Return how long cflib takes to connect, s; `HANGS` where it never returns."""
    swarm = Swarm(uris, factory=CachedCfFactory(rw_cache=str(cache)))
    begun = time.perf_counter()
    opening = threading.Thread(target=swarm.open_links, daemon=True)
    opening.start()
    opening.join(HANGS)  # it asks nothing twice over UDP
    took = time.perf_counter() - begun
    if not opening.is_alive():
        swarm.parallel_safe(lambda link: link.close_link())  # one after the other takes 1 s each
    return took


def connecting(drones: Drones) -> dict[str, float]:
    """Return medians of the time to connect all drones, s, and the ratios of cflib's to ours."""
    times: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        with TemporaryDirectory() as ours, TemporaryDirectory() as theirs:
            for tables in ("cold", "cached"):
                took, failure = connected(drones.scene(), Path(ours))
                if failure:
                    raise SystemExit(failure)
                times.setdefault(f"connect_{tables}_s", []).append(took)
                took = connected_by_cflib(drones.uris, Path(theirs))
                times.setdefault(f"connect_{tables}_cflib_s", []).append(took)
            took, failure = connected(drones.scene(dead=1), Path(ours))
            if f"cf{MANY} (" not in failure:
                raise SystemExit(f"the dead drone is not named: {failure!r}")
            times.setdefault("dead_named_s", []).append(took)
            took, _ = connected(drones.scene(dead=1), Path(ours), absent="fly-without")
            times.setdefault("connect_without_s", []).append(took)
    figures = {name: statistics.median(values) for name, values in times.items()}
    for tables in ("cold", "cached"):
        ours_s, theirs_s = figures[f"connect_{tables}_s"], figures[f"connect_{tables}_cflib_s"]
        figures[f"connect_{tables}_ratio"] = theirs_s / ours_s
    return figures


def steering(drones: Drones) -> dict[str, float]:
    """Return how late setpoints are, ms."""
    room = drones.scene()
    n = len(room.agents)
    with TemporaryDirectory() as cache:
        options = fill_defaults({"cache": cache, "guardian": GUARDIAN}, OPTIONS)
        radio = star_radio.make(room, **options)
        radio.connect()
        still = Setpoint(np.zeros((n, 3)), np.zeros(n), np.ones(n, np.bool_))
        asleep = Sleeper(room.period)
        radio.wait(0.0)
        late, busy, reports, used = [], [], 0, time.process_time()
        for i in range(1, TICKS + 1):
            woke = radio.wait(i * room.period)
            computed = time.thread_time()  # which may take longer than the rest
            at = time.monotonic()
            reports += len(radio.receive().odometry.agent)
            radio.send(still)
            late.append(1000 * (woke - i * room.period + time.monotonic() - at))
            busy.append(1000 * (time.thread_time() - computed))
        share = (time.process_time() - used) / (TICKS * room.period)
        radio.close()
    p50, p99 = np.percentile(late, [50, 99])
    bare = float(np.percentile(asleep.late(), 99))
    return {
        "setpoint_p50_ms": float(p50),
        "setpoint_p99_ms": float(p99),
        "setpoint_worst_ms": max(late),
        "setpoint_processor_p99_ms": float(np.percentile(busy, 99)),
        "sleep_p99_ms": bare,
        "setpoint_to_sleep_p99_ratio": float(p99) / bare,
        "processor_share": share,
        "reports_per_drone_s": reports / n / (TICKS * room.period),
    }


class Sleeper:
    """A loop in another process that does nothing but sleep until each tick is due."""

    def __init__(self, period: float) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        context.Process(target=sleeping, args=(period, TICKS, theirs), daemon=True).start()
        self._pipe.recv()

    def late(self) -> list[float]:
        """Return how late each tick was, ms."""
        late: list[float] = self._pipe.recv()
        return late


def sleeping(period: float, ticks: int, pipe: Connection) -> None:
    """Send how late a loop is that only sleeps, ms."""
    pipe.send("begun")
    begun = time.monotonic()
    late = []
    for i in range(1, ticks + 1):
        time.sleep(max(0.0, begun + i * period - time.monotonic()))
        late.append(1000 * (time.monotonic() - begun - i * period))
    pipe.send(late)


def main() -> None:
    """Measure, and print."""
    options = command_line(__doc__).parse_args()
    cflib.crtp.init_drivers()
    logger = logging.getLogger("star_radio")
    logger.setLevel(logging.ERROR)  # a drone is absent on purpose
    figures: dict[str, float] = {}
    for n, measure in ((MANY, connecting), (FEW, steering)):
        drones = Drones(n)
        figures |= measure(drones)
        drones.close()
    logger.setLevel(logging.NOTSET)
    show(figures, as_json=options.json)


if __name__ == "__main__":
    main()
