"""One flight of the fault matrix: flown, watched, and judged by the policies."""

from __future__ import annotations

import json
import resource
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr
from itertools import combinations
from pathlib import Path
from typing import Any, Final
from zlib import crc32

import numpy as np

from star_basics.flight import run_mission
from star_core import Event, InputError, PluginError, Registry, Tick, hookimpl, read_run
from star_core.discovery import Source
from tests.campaign.fault_cells import CROSSING, ROOM, RULED, Cell
from tests.simulators import SimulatorWitness

CROSSING_TIME: Final = (3.3, 6.3)  # s, in which the drones cross: none takes off or lands
ENDINGS: Final = {"safety", "failure", "plugin", "interrupt", "observer"}  # kinds of events
CONTACT: Final = 0.12  # m between the centers of two drones that touch
FENCE_MARGIN: Final = 0.2  # m, for the error of the estimates that the fence is kept by
GROUND: Final = 0.1  # m
MAX_DOWN: Final = 15.0  # s on the way to the ground after an agent left, or the mission failed
MAX_IMPACT: Final = 1.0  # m/s; a drone that lands is slower
AFTER: Final = 5.0  # s of simulation after the program has ended


class Witness(SimulatorWitness):
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
        self.speed_limit = np.inf
        self.names: tuple[str, ...] = ()
        self.time: list[float] = []
        self.truth: list[np.ndarray] = []
        self.finite = True
        self.speed = 0.0
        self.events: list[Event] = []

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
    at, victim = round(float(random.uniform(*CROSSING_TIME)), 2), f"cf{random.integers(1, 5)}"
    cell_faults = list(cell.faults)
    if cell.pairs:
        pairs = list(combinations(RULED, 2))
        cell_faults = [fault for _, fault in pairs[seed % len(pairs)]]
    faults = [
        {
            **({"at": at} if fault["component"] != "tags" else {}),
            **fault,
            **({"agents": victim} if fault.get("agents") == "one" else {}),
        }
        for fault in cell_faults
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
        if status == 2:
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
    removed = [e for e in witness.events if e.kind in ENDINGS]
    ended = [i for i in (rows if status == 0 else range(len(up))) if status or removed]
    late = 0.0
    for i in ended:  # from when the agent left, or from when the mission failed
        own = [e.time for e in removed if i in rows and e.time >= at and witness.names[i] in e.text]
        failed = [e.time for e in removed if e.agent is None and e.time <= down[i]]
        last = max(failed, default=down[i])
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
