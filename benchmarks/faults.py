"""The fault matrix: each cell flown with many seeds, and judged by the same policies.

A cell is a mission with faults at a random time and of a random agent. Every flight is flown as by
``star run MISSION --faults FILE``, and then watched for another 5 s without the program. The world
is the default one of `sim`, or the ideal one with ``--world ideal``. Flights are kept in a file for
each world and commit, which is written all the time: the same command again flies those that are
missing, also after an interrupt, and ``--page`` puts the table of all into a page. ``--minutes``
ends a piece of a campaign. What the flights that are missing will take is printed first, as far
as flights of the same cells have been measured.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import redirect_stderr
from dataclasses import dataclass, field, replace
from itertools import combinations
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final
from zlib import crc32

import numpy as np
from scipy.stats import beta

from star_core import Event, InputError, PluginError, Registry, Tick, hookimpl, read_run
from star_core.cli.run import run_mission
from star_core.plugin_support.discovery import Source

CONTACT: Final = 0.12  # m between the centers of two drones that touch
FENCE_MARGIN: Final = 0.2  # m, for the error of the estimates that the fence is kept by
GROUND: Final = 0.1  # m
MAX_DOWN: Final = 15.0  # s on the way to the ground after an agent left, or the mission failed
MAX_IMPACT: Final = 1.0  # m/s; a drone that lands is slower
AFTER: Final = 5.0  # s of simulation after the program has ended
SEEDS: Final = 30  # flights of each cell
MANY_SEEDS: Final = 300  # of the cells of some rows
MANY_ROWS: Final = ("1", "4", "11")  # lost links, localizers and avoiders
SAVING_PERIOD: Final = 10.0  # s between two writes of the results

ROOM: Final[dict[str, Any]] = {
    "star": 1,
    "name": "room",
    "fence": {"low": [-2, -2, 0], "high": [2, 2, 2]},
    "landmarks": {
        f"{x}{y}": {"tags": [2 * (3 * i + k), 2 * (3 * i + k) + 1], "at": [a, b, 0]}
        for i, (x, a) in enumerate({"west_": -0.9, "mid_": 0, "east_": 0.9}.items())
        for k, (y, b) in enumerate({"south": -0.9, "mid": 0, "north": 0.9}.items())
    },
}
IDEAL: Final[dict[str, Any]] = {"use": "sim", "profile": "ideal", "controller": "ideal"}
CROSSING: Final[dict[str, Any]] = {
    "star": 1,
    "name": "crossing",
    "world": "room.yaml",
    "swarm": {
        "cf1": {"start": [-0.8, 0.4, 0]},
        "cf2": {"start": [0.8, 0.4, 0], "yaw_deg": 180},
        "cf3": {"start": [-0.8, -0.4, 0]},
        "cf4": {"start": [0.8, -0.4, 0], "yaw_deg": 180},
    },
    "transport": IDEAL,
    "localizer": "flow",
    "planner": "straight",
    "avoider": "orca",
    "safety": {
        "link_lost": {},
        "position_lost": {},
        "battery_low": {},
        "tumbled": {},
    },
    "mission": [
        {"takeoff": {"height": 0.6, "speed": 0.5}},
        {
            "parallel": [
                {"goto": {"agents": "cf1", "to": [0.8, 0.4, 0.6]}},
                {"goto": {"agents": "cf2", "to": [-0.8, 0.4, 0.6]}},
                {"goto": {"agents": "cf3", "to": [0.8, -0.4, 0.6]}},
                {"goto": {"agents": "cf4", "to": [-0.8, -0.4, 0.6]}},
            ]
        },
        {"land": {}},
    ],
}
SEEING: Final[dict[str, Any]] = {
    "swarm": {name: {**agent, "camera": "aideck"} for name, agent in CROSSING["swarm"].items()},
    "transport": IDEAL | {"camera": {"mode": "geometric"}},
    "localizer": {"use": "apriltag", "processes": 0},
}
RENDERED: Final[dict[str, Any]] = SEEING | {  # of one camera, for speed
    "swarm": CROSSING["swarm"] | {"cf1": SEEING["swarm"]["cf1"]},
    "transport": IDEAL | {"camera": {"mode": "rendered"}},
}
JOINING: Final[dict[str, Any]] = {
    "reserve": {"agents": ["cf4"]},
    "mission": [
        {"takeoff": {"height": 0.6, "speed": 0.5}},
        {"hold": {"for": 1}},
        {"join": {"agents": "cf4"}},
        {"goto": {"agents": "cf4", "to": [0, 0, 0.6]}},
        {"land": {}},
    ],
}


@dataclass(frozen=True)
class Cell:
    """A cell of the matrix.

    Attributes:
        row: Of the matrix.
        name: What happens.
        faults: Keys of faults; ``at`` is drawn if it is not given, and ``agents: one`` is an agent.
        changes: Of the mission.
        status: Exit statuses that are right.
        act: Called in the tick of the drawn time, with the operator.
        spoofed: Whether the agent that has the fault is not judged, only the others.
        most: Flights, where fewer than asked for suffice or many take too long.
    """

    row: str
    name: str
    faults: Sequence[Mapping[str, Any]] = ()
    changes: Mapping[str, Any] = field(default_factory=dict)
    status: tuple[int, ...] = (0,)
    act: Callable[[Any], None] | None = None
    spoofed: bool = False
    most: int = 10**6


def one(component: str, mode: str, **values: Any) -> Mapping[str, Any]:
    """Return a fault of one agent."""
    return {"component": component, "mode": mode, "agents": "one", **values}


def every(component: str, mode: str, **values: Any) -> Mapping[str, Any]:
    """Return a fault of all agents."""
    return {"component": component, "mode": mode, **values}


def plugin(kind: str, mode: str, **values: Any) -> Mapping[str, Any]:
    """Return a fault of a plugin."""
    return every("plugin", mode, plugin=kind, **values)


def _signal(number: int) -> Callable[[Any], None]:
    return lambda _operator: os.kill(os.getpid(), number)


def _jump(seconds: float) -> Callable[[Any], None]:
    def jump(_operator: Any) -> None:
        right = time.time
        time.time = lambda: right() + seconds

    return jump


def _fill_disk(_operator: Any) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))


EITHER: Final = (0, 1)
RULED: Final = (  # one of each of the rows 1 to 9, for pairs
    ("1 link", one("link", "off")),
    ("2 loss", every("link", "intermittent", loss=0.2)),
    ("3 all links", every("link", "off")),
    ("4 localizer", plugin("localizer", "wrong", offset=[1, 0, 0], agents="one")),
    ("5 reports", one("telemetry", "garbage")),
    ("6 slow reports", one("telemetry", "slow", rate=1.0)),
    ("7 battery", one("battery", "wrong", factor=0.75)),
    ("8 motor", one("motor", "off")),
    ("9 flow", one("flow", "wrong", factor=0.7)),
)
CELLS: Final = (
    Cell("0", "no fault"),
    Cell("1", "link of one drone off, permanently", [one("link", "off")], status=EITHER),
    Cell("1", "link of one drone off, 0.3 s", [one("link", "off", **{"for": 0.3})]),
    Cell("1", "link of one drone off, 2 s", [one("link", "off", **{"for": 2.0})], status=EITHER),
    Cell("1", "reports of one drone off, permanently", [one("telemetry", "off")], status=EITHER),
    Cell("2", "5 % loss", [every("link", "intermittent", at=0, loss=0.05)]),
    Cell("2", "20 % loss", [every("link", "intermittent", at=0, loss=0.2)]),
    Cell("2", "30 % loss", [every("link", "intermittent", at=0, loss=0.3)], status=EITHER),
    Cell("2", "20 ms delay each way", [every("link", "delayed", at=0, delay=0.02)]),
    Cell("2", "200 ms delay each way", [every("link", "delayed", at=0, delay=0.2)], status=EITHER),
    Cell("3", "all links off", [every("link", "off")], status=(1,)),
    Cell("4", "localizer raises", [plugin("localizer", "off")], status=(1,)),
    Cell("4", "localizer stuck", [plugin("localizer", "stuck")], status=EITHER),
    Cell("4", "localizer: one drone +1 m", [plugin("localizer", "wrong", agents="one")]),
    Cell("4", "localizer: one drone +2 m", [
        plugin("localizer", "wrong", agents="one", offset=[2, 0, 0])
    ]),
    Cell("4", "localizer NaN", [plugin("localizer", "garbage")], status=(1,)),
    Cell("4", "localizer 0.2 s late", [plugin("localizer", "delayed")], status=EITHER),
    Cell("4", "reports of one drone are NaN and random", [one("telemetry", "garbage")]),
    Cell("5", "two landmarks exchanged", [
        {"component": "tags", "mode": "wrong", "swap": True, "tags": ["mid_mid", "west_mid"]}
    ], SEEING, EITHER),
    Cell("5", "a landmark moved by 0.5 m", [
        {"component": "tags", "mode": "wrong", "offset": [0.5, 0, 0], "tags": ["mid_mid"]}
    ], SEEING, EITHER),
    Cell("5", "all landmarks covered", [{"component": "tags", "mode": "off"}], SEEING, EITHER),
    Cell("6", "cameras off", [every("camera", "off")], SEEING, EITHER),
    Cell("6", "cameras at 1 Hz", [every("camera", "slow", rate=1.0)], SEEING, EITHER),
    Cell("6", "images dark", [every("camera", "wrong", factor=0.05)], RENDERED, EITHER, most=10),
    Cell("6", "images cut off", [every("camera", "garbage")], RENDERED, EITHER, most=10),
    Cell("6", "images stuck", [every("camera", "stuck")], RENDERED, EITHER, most=10),
    Cell("7", "battery of one drone reports 3.0 V", [one("battery", "wrong", factor=0.75)]),
    Cell("7", "battery of one drone not reported", [one("battery", "off")]),
    Cell("7", "battery of one drone random", [one("battery", "garbage")]),
    Cell("7", "battery of one drone at 2 %", [one("battery", "wrong", charge=0.02)]),
    Cell("7", "battery of one drone empty", [one("battery", "wrong", charge=0.0)]),
    Cell("8", "a motor stops", [one("motor", "off")]),
    Cell("8", "thrust of one drone -20 %", [one("motor", "wrong", motors=[1, 2, 3, 4])],
         status=EITHER),
    Cell("8", "a motor fails in 30 % of ticks", [one("motor", "intermittent")], status=EITHER),
    Cell("9", "goal outside of the fence", changes={
        "mission": [{"takeoff": {}}, {"goto": {"agents": "cf1", "to": [4, 0, 0.6]}}]
    }, status=(2,), most=1),
    Cell("9", "flow sensor of one drone x 0.7", [one("flow", "wrong", factor=0.7)], status=EITHER),
    Cell("9", "flow sensor of one drone stuck", [one("flow", "stuck")], status=EITHER),
    *(
        Cell("10", f"position of one drone spoofed by {d} m", [
            one("telemetry", "wrong", offset=[d, 0, 0])
        ], {"collisions": "record"}, EITHER, spoofed=True)
        for d in (0.2, 0.5, 1.0, 2.0)
    ),
    Cell("11", "avoider raises", [plugin("avoider", "off")], status=(1,)),
    Cell("11", "avoider raises in 30 % of ticks", [plugin("avoider", "intermittent")], status=(1,)),
    Cell("11", "avoider NaN", [plugin("avoider", "garbage")], status=(1,)),
    Cell("11", "avoider 10 x too fast", [plugin("avoider", "wrong", factor=10)], status=EITHER),
    Cell("11", "avoider stuck", [plugin("avoider", "stuck")], status=EITHER),
    Cell("12", "planner raises", [plugin("planner", "off")], status=(1,)),
    Cell("12", "planner NaN", [plugin("planner", "garbage")], status=(1,)),
    Cell("12", "planner 10 x too fast", [plugin("planner", "wrong", factor=10)], status=EITHER),
    Cell("12", "planner stuck", [plugin("planner", "stuck")], status=EITHER),
    Cell("13", "transport raises for 0.3 s", [plugin("transport", "off", **{"for": 0.3})],
         status=EITHER),
    Cell("13", "transport raises in every call", [plugin("transport", "off")], status=(1,)),
    Cell("16", "clock jumps by an hour", act=_jump(3600.0)),
    Cell("16", "clock jumps back by an hour", act=_jump(-3600.0)),
    Cell("16", "program stalls for 2 s", [every("ground_program", "delayed", delay=2.0)], most=5),
    Cell("17", "disk full", act=_fill_disk),
    Cell("18", "pairs of rows 1 to 9", status=EITHER),
    Cell("19", "Ctrl-C", act=_signal(signal.SIGINT), status=(1,)),
    Cell("19", "SIGTERM", act=_signal(signal.SIGTERM), status=(1,)),
    Cell("19", "terminal closed (SIGHUP)", act=_signal(signal.SIGHUP), status=(1,)),
    Cell("20", "join of a drone with 3.0 V", [
        {"component": "battery", "mode": "wrong", "factor": 0.75, "agents": "cf4", "at": 0}
    ], JOINING, EITHER),
    Cell("20", "join of a drone that is not heard", [
        {"component": "link", "mode": "off", "agents": "cf4", "at": 1.0}
    ], JOINING, (1,)),
)  # fmt: skip


class Witness:
    """Observes a flight: what its policies are judged by.

    Args:
        cell: Its cell.
        at: Time at which the cell acts, s.
    """

    def __init__(self, cell: Cell, at: float) -> None:
        self._cell = cell
        self._at = at
        self._operator: Any = None
        self._act = cell.act
        self.simulator: Any = None
        self.speed_limit = np.inf
        self.names: tuple[str, ...] = ()
        self.time: list[float] = []
        self.truth: list[np.ndarray] = []
        self.finite = True
        self.speed = 0.0
        self.events: list[Event] = []

    @hookimpl(wrapper=True)
    def star_transports(self) -> Generator[None, Any, list[list[Any]]]:
        offers = yield

        def kept(make: Callable[..., Any]) -> Callable[..., Any]:
            def made(*arguments: Any, **options: Any) -> Any:
                self.simulator = make(*arguments, **options)
                return self.simulator

            return made

        return [[replace(one, make=kept(one.make)) for one in own] for own in offers]

    @hookimpl
    def star_mission_started(self, flight: Any, operator: Any) -> None:
        self._operator = operator
        self.names, self.speed_limit = flight.scene.names, flight.scene.limits.speed

    @hookimpl
    def star_ticked(self, tick: Tick) -> None:
        active = tick.sent.active
        velocity = tick.sent.velocity[active]
        self.finite &= bool(
            np.isfinite(velocity).all() and np.isfinite(tick.sent.yaw[active]).all()
        )
        self.speed = max(self.speed, float(np.linalg.norm(velocity, axis=1).max(initial=0.0)))
        self._see(tick.time)
        if self._act is not None and tick.time >= self._at:
            act, self._act = self._act, None
            act(self._operator)

    @hookimpl
    def star_event(self, event: Event) -> None:
        self.events.append(event)

    def _see(self, now: float) -> None:
        truth = type(self.simulator).truth(self.simulator)
        self.time.append(now)
        self.truth.append(np.concatenate([truth.position, truth.velocity], axis=1))

    def watch_on(self) -> None:
        """Let the drones fly on without the program."""
        if self.simulator is None or not self.time:
            return
        begun = self.time[-1]
        for k in range(1, round(AFTER / 0.05)):
            type(self.simulator).wait(self.simulator, begun + 0.05 * k)
            self._see(begun + 0.05 * k)


def in_world(mission: Mapping[str, Any], world: str) -> dict[str, Any]:
    """Return a mission in the ideal world as one in a world, ``ideal`` or ``default``."""
    transport = dict(mission["transport"])
    if world == "default":
        del transport["profile"], transport["controller"]
    return {**mission, "transport": transport}


def flown(cell: Cell, seed: int, world: str) -> dict[str, Any]:
    """Fly a cell with a seed in a world; return the verdicts of the policies, and figures."""
    begun = time.process_time()
    random = np.random.default_rng([seed, crc32(cell.name.encode())])
    at, victim = round(float(random.uniform(2.0, 5.0)), 2), f"cf{random.integers(1, 5)}"
    given = list(cell.faults)
    if cell.row == "18":
        pairs = list(combinations(RULED, 2))
        given = [fault for _, fault in pairs[seed % len(pairs)]]
    faults = [
        {
            **({"at": at} if fault["component"] != "tags" else {}),
            **fault,
            **({"agents": victim} if fault.get("agents") == "one" else {}),
        }
        for fault in given
    ]
    witness, registry = Witness(cell, at), Registry()
    registry.add(witness, Source("matrix:witness"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "room.yaml").write_text(json.dumps(ROOM))
        mission = in_world({**CROSSING, **cell.changes}, world)
        (folder / "mission.yaml").write_text(json.dumps(mission))
        (folder / "faults.yaml").write_text(json.dumps({"star": 1, "faults": faults}))
        at = min((fault.get("at", 0.0) for fault in faults), default=at)
        status = _run(folder, seed, registry, faulty=bool(faults))
        if status == 2:  # noqa: PLR2004 -- bad input
            return {"status": status, "broken": [] if status in cell.status else ["status"]}
        witness.watch_on()
        readable = True
        try:
            readable = cell.row == "17" or _last(folder / "out") >= at - 1
        except (OSError, InputError, KeyError):
            readable = False
    names = [fault.get("agents") for fault in faults]
    concerned = [] if None in names else [str(name) for name in names]  # none: all agents are
    verdict = judged(cell, witness, status, at, concerned, readable=readable)
    return verdict | {"cpu_s": round(time.process_time() - begun, 1)}


def _last(folder: Path) -> float:
    """Return the last time in a record, s."""
    return float(read_run(folder).arrays["time"][-1])


def _run(folder: Path, seed: int, registry: Registry, *, faulty: bool) -> int:
    """Run ``star run`` in this process; return its exit status."""
    clock, limit = time.time, resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        with (folder / "stderr.txt").open("w") as text, redirect_stderr(text):
            status, _ = run_mission(
                str(folder / "mission.yaml"),
                [f"seed={seed}"],
                registry,
                out=str(folder / "out"),
                keep=True,
                save_frames=False,
                observers={"faults": [str(folder / "faults.yaml")]} if faulty else {},
                as_json=True,
            )
    except (InputError, PluginError):
        return 2
    else:
        return status
    finally:
        time.time = clock
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)


def judged(
    cell: Cell,
    witness: Witness,
    status: int,
    at: float,
    concerned: Sequence[str],
    *,
    readable: bool,
) -> dict[str, Any]:
    """Return the names of the policies that a flight broke, and its figures."""
    times, truth = np.array(witness.time), np.array(witness.truth)
    position, climb = truth[..., :3], truth[..., 5]
    rows = [i for i, name in enumerate(witness.names) if name in concerned]
    judged_rows = [i for i in range(len(witness.names)) if not (cell.spoofed and i in rows)]
    nearest = _nearest(position[:, judged_rows])
    outside = np.maximum(position - 2.0, [-2.0, -2.0, 0.0] - position)[:, judged_rows].max()
    high: Any = position[..., 2] > GROUND
    up = high.any(axis=0)  # flew at all
    down = [float(times[np.flatnonzero(high[:, i])[-1]]) if up[i] else 0.0 for i in range(len(up))]
    removed = [e for e in witness.events if e.kind in {"safety", "failure", "plugin", "interrupt"}]
    ended = [i for i in (rows if status == 0 else range(len(up))) if status or removed]
    late = 0.0
    for i in ended:  # from when the agent left, or from the last failure before it landed
        own = [e.time for e in removed if i in rows and e.time >= at and witness.names[i] in e.text]
        last = max((e.time for e in removed if e.time <= down[i]), default=down[i])
        late = max(late, down[i] - min(own, default=last))
    falls: Any = climb[1:].min(axis=0) < -MAX_IMPACT
    innocent = [i for i in judged_rows if i not in rows]
    attributed = any(
        e.time >= at - 1 and (not rows or any(witness.names[i] in e.text for i in rows))
        for e in removed
    )
    broken = {
        "status": status not in cell.status,
        "separation": nearest < CONTACT,
        "fence": outside > FENCE_MARGIN,
        "NaN": not witness.finite,
        "speed": witness.speed > 1.01 * witness.speed_limit,
        "down": late > MAX_DOWN or bool(high[-1, judged_rows].any()),
        "fall": bool(rows) and bool(falls[innocent].any()),
        "record": not readable,
        "event": bool(ended) and not attributed,
    }
    return {
        "status": status,
        "broken": [name for name, is_broken in broken.items() if is_broken],
        "nearest": round(nearest, 3),
        "outside": round(float(outside), 3),
        "down": round(late, 2),
        "speed": round(witness.speed, 3),
        "fallen": int(falls.sum()),
        "events": [str(e) for e in witness.events if e.kind != "step"],
    }


def _nearest(position: np.ndarray) -> float:
    """Return the least distance of two drones of which one is in the air, m."""
    high = position[..., 2] > GROUND
    least = np.inf
    for i, j in combinations(range(position.shape[1]), 2):
        apart = np.linalg.norm(position[:, i] - position[:, j], axis=1)
        least = min(least, float(apart[high[:, i] | high[:, j]].min(initial=np.inf)))
    return least


def upper_bound(failures: int, flights: int) -> float:
    """Return the 95 % upper bound of a probability (Clopper and Pearson, one-sided).

    >>> round(upper_bound(0, 30), 3)
    0.095
    """
    return 1.0 if failures == flights else float(beta.ppf(0.95, failures + 1, flights - failures))


def table(results: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield the lines of the table."""
    heads = "row", "fault", "n", "broken", "≤ (95 %)", "policies", "exit status", "nearest", "down"
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for cell in CELLS:
        flights = [one for key, one in results.items() if key.rpartition("/")[0] == cell.name]
        if not flights:
            continue
        n, bad = len(flights), sum(bool(one["broken"]) for one in flights)
        policies = Counter(name for one in flights for name in one["broken"])
        why = ", ".join(f"{name} {count}" for name, count in policies.most_common())
        statuses = ", ".join(
            f"{k}: {v}" for k, v in sorted(Counter(f["status"] for f in flights).items())
        )
        nearest = min((one.get("nearest", np.inf) for one in flights), default=np.inf)
        down = max((one.get("down", 0.0) for one in flights), default=0.0)
        yield (
            f"| {cell.row} | {cell.name} | {n} | {bad} | {100 * upper_bound(bad, n):.0f} % | {why} "
            f"| {statuses} | {f'{nearest:.2f} m' if nearest < np.inf else ''} "
            f"| {f'{down:.1f} s' if down else ''} |"
        )


def fly_missing(
    results: dict[str, Any], missing: Sequence[tuple[int, int]], options: argparse.Namespace
) -> None:
    """Fly cells with seeds in processes; add what happened to the results and their file.

    Args:
        results: By name of the cell and seed.
        missing: Indices of cells and seeds.
        options: Of the command line.
    """
    made_at = _commit()
    end, saved = time.monotonic() + 60 * options.minutes, time.monotonic()
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        flights = {
            pool.submit(_flown, index, seed, options.world, end): f"{CELLS[index].name}/{seed}"
            for index, seed in missing
        }
        for flight in as_completed(flights):
            key, verdict = flights[flight], flight.result()
            if verdict is None:
                continue
            results[key] = verdict
            if verdict["broken"]:
                print(key, verdict["broken"], file=sys.stderr, flush=True)
            if time.monotonic() >= saved + SAVING_PERIOD:
                saved = time.monotonic()
                _save(options, made_at, results)
    _save(options, made_at, results)


def _flown(index: int, seed: int, world: str, end: float) -> dict[str, Any] | None:
    if time.monotonic() >= end:
        return None
    return flown(CELLS[index], seed, world)  # the cell itself cannot be sent to a process


def _save(options: argparse.Namespace, commit: str, results: Mapping[str, Any]) -> None:
    content = {"commit": commit, "world": options.world, "flights": results}
    part = options.results.with_suffix(".part")
    part.write_text(json.dumps(content, indent=1), encoding="utf-8")
    part.replace(options.results)


def _load(options: argparse.Namespace, commit: str) -> dict[str, Any]:
    """Return the flights in the file of the results, which must be of this commit and world."""
    if not options.results.exists():
        return {}
    content: dict[str, Any] = json.loads(options.results.read_text(encoding="utf-8"))
    if (content.get("commit"), content.get("world")) != (commit, options.world):
        sys.exit(f"{options.results} is not of commit {commit} in the {options.world} world")
    flights: dict[str, Any] = content["flights"]
    return flights


def _commit() -> str:
    command = "git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty"
    return subprocess.run(
        [*command, "--exclude=*"], capture_output=True, text=True, check=True
    ).stdout.strip()


def costs(results: Mapping[str, Any], missing: Sequence[tuple[int, int]]) -> Iterator[str]:
    """Yield what the missing flights of each row take, by flights of their cells in the results."""
    measured: dict[str, list[float]] = {}
    for key, one in results.items():
        measured.setdefault(key.rpartition("/")[0], []).append(one.get("cpu_s", 0.0))
    total = 0.0
    for row in dict.fromkeys(cell.row for cell in CELLS):
        names = [CELLS[index].name for index, _ in missing if CELLS[index].row == row]
        known = [np.mean(measured[name]) for name in names if name in measured]
        seconds = float(np.mean(known)) * len(names) if known else 0.0
        total += seconds
        if names:
            took = f"{seconds / 60:.0f} min of processor time" if known else "not measured yet"
            yield f"row {row}: {len(names)} flights, {took}"
    if total:
        yield f"all that is measured: {total / 3600:.1f} h of processor time"


def main() -> None:
    """Fly what is missing, and print the table."""
    os.environ.setdefault("STAR_BLOCK_PLUGINS", "mcap")  # it starts a process for each flight
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    many = f"{MANY_SEEDS} in rows {', '.join(MANY_ROWS)}, {SEEDS} in the others"
    parser.add_argument("--seeds", type=int, help=f"of each cell; if not given, {many}")
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument("--cells", default="", help="fly only cells whose names contain this")
    parser.add_argument("--rows", nargs="*", help="fly only these rows")
    parser.add_argument("--world", choices=("default", "ideal"), default="default")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no flight later")
    parser.add_argument("--estimate", action="store_true", help="only print what it would take")
    parser.add_argument("--results", type=Path, help="runs/faults-WORLD-COMMIT.json if not given")
    parser.add_argument("--page", type=Path, help="put the table into this page")
    options = parser.parse_args()
    commit = _commit()
    options.results = options.results or Path(f"runs/faults-{options.world}-{commit}.json")
    options.results.parent.mkdir(parents=True, exist_ok=True)
    results = _load(options, commit)
    missing = [
        (index, options.first + k)
        for k in range(options.seeds or MANY_SEEDS)
        for index, cell in enumerate(CELLS)
        if k < min(cell.most, options.seeds or (MANY_SEEDS if cell.row in MANY_ROWS else SEEDS))
        and options.cells in cell.name
        and (not options.rows or cell.row in options.rows)
        and f"{cell.name}/{options.first + k}" not in results
    ]
    print(*costs(results, missing), sep="\n", file=sys.stderr, flush=True)
    if options.estimate:
        return
    fly_missing(results, missing, options)
    made = "\n".join(table(results))
    print(made)
    if options.page:
        text = options.page.read_text(encoding="utf-8")
        before, _, rest = text.partition("<!-- table -->\n")
        _, _, after = rest.partition("<!-- end -->\n")
        options.page.write_text(
            f"{before}<!-- table -->\n{made}\n\n<!-- end -->\n{after}", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
