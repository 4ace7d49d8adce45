"""What becomes of flights whose program fails, and what the guardian costs per tick.

``python -m tests.campaign.guardian [--runs 30] [--only sigkill,gil] [--cost]`` prints a table. Each
run is ``star run`` over UDP against four simulated Crazyflies (`star fleet`) in real time; the
fault comes at a random time between take-off and the last seconds of the mission, by the run's
seed. A run passes if all drones are on the floor within 15 s, none locked, none faster than 1 m/s
when it touches the floor, and no two of them closer than 0.2 m.

The faults are those of the flight's process (``sigkill``, ``sigstop``, ``gil``: a C function that
keeps the interpreter's lock and is not interrupted by signals, ``hang``: an endless loop, ``exit``:
`os._exit`, ``memory``: the address space is used up, and what was allocated is kept) and of the
guardian (``guardian-kill``, ``guardian-stop``), or of both at the same time (``both``). `--cost`
measures the cost instead.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

import star_radio
from star_core import Registry, Scene, Setpoint, load
from star_core.toolkit import fill_defaults
from star_fleet.server import Fleet
from star_radio.options import OPTIONS
from star_sim import ideal_world

MAX_TIME = 15.0  # s, from the fault until all drones are on the floor
MAX_IMPACT = 1.0  # m/s
MIN_DISTANCE = 0.2  # m, `limits.separation` if it is not given
ON_FLOOR = 0.05  # m
TAKEN_OFF = 0.1  # m
WINDOW = (0.0, 12.0)  # s after the first drone has taken off, for the fault
PATIENCE = 120.0  # s, for the program to start

INSIDE = {
    "gil": """
import ctypes, signal
signal.pthread_sigmask(signal.SIG_BLOCK, signal.valid_signals())
ctypes.PyDLL(None).sleep(20)
""",
    "hang": "while True: pass",
    "exit": "import os; os._exit(3)",
    "memory": """
import resource
kept = globals().setdefault("kept", [])
with open("/proc/self/statm") as statm:
    used = int(statm.read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + (64 << 20),) * 2)
while True:
    kept.append(bytearray(1 << 16))
""",
}
"""Faults of a plugin, executed in a tick."""

OUTSIDE = ("sigkill", "sigstop", "guardian-kill", "guardian-stop", "both")
KINDS = ("sigkill", "sigstop", *INSIDE, *OUTSIDE[2:])

PROGRAM = """
import pathlib, sys
from star_core.commands.main import main
from star_straight.planner import Straight
plan, flag = Straight.plan, pathlib.Path(sys.argv[1])
def faulty(self, estimate, goals):
    if flag.exists():
        exec(flag.read_text(), globals())
    return plan(self, estimate, goals)
Straight.plan = faulty
sys.exit(main(sys.argv[2:]))
"""

MISSION = """\
star: 1
name: guarded
world: room.yaml
rate: 20
transport: sim
localizer: flow
planner: straight
avoider: orca
swarm:
{swarm}
mission:
  - takeoff: {{height: 0.6}}
  - goto: {{agents: [cf1, cf3], by: [1.2, 0, 0.4]}}
  - parallel:
      - goto: {{agents: cf2, by: [-1.2, 0, 0]}}
      - goto: {{agents: cf4, by: [-1.2, 0, 0]}}
  - hold: {{for: 5}}
  - land: {{}}
"""
ROOM = "star: 1\nname: room\nfence: {low: [-3, -3, 0], high: [3, 3, 2]}\n"


class Watched(Fleet):
    """A fleet that notes impacts on the floor and the closest approach."""

    def __init__(self, room: Scene) -> None:
        n = len(room.agents)
        self.impact = np.zeros(n)
        self.nearest = np.inf
        self._pairs = np.triu_indices(n, 1)
        super().__init__(room, port=0, **ideal_world(noise=False, speed=1.0))

    @property
    def height(self) -> Any:
        """(N,) m."""
        return self.simulator.drones["position"][:, 2].copy()

    def advance(self) -> None:
        drones = self.simulator.drones
        before, falling = self.height, -drones["velocity"][:, 2].copy()
        super().advance()
        landed = (before > 0) & (self.height <= 0)
        self.impact = np.where(landed, np.maximum(self.impact, falling), self.impact)
        first, second = self._pairs
        position = drones["position"]
        nearest = np.linalg.norm(position[first] - position[second], axis=1).min()
        self.nearest = min(self.nearest, float(nearest))


class Outcome(NamedTuple):
    """What became of a flight: times in s, speeds in m/s, distances in m."""

    fault: str
    seed: int
    at: float
    down_after: float
    impact: float
    nearest: float
    locked: int
    status: int | None
    log: str

    @property
    def passed(self) -> bool:
        """Whether all drones landed."""
        landed = self.down_after <= MAX_TIME and not self.locked and self.impact <= MAX_IMPACT
        return landed and self.nearest >= MIN_DISTANCE


def flown(fault: str, seed: int, folder: Path) -> Outcome:
    """Fly once, with a fault."""
    (folder / "room.yaml").write_text(ROOM)
    starts = ((-0.6, -0.6), (0.6, 0.6), (-0.6, 1.2), (0.6, -1.2))
    swarm = "\n".join(
        f"  cf{i}: {{start: [{x}, {y}, 0]}}" for i, (x, y) in enumerate(starts, start=1)
    )
    mission, flag = folder / "mission.yaml", folder / "fault.py"
    mission.write_text(MISSION.format(swarm=swarm))
    room = load(mission, Registry()).scene
    at = float(np.random.default_rng(seed).uniform(*WINDOW))
    with Watched(room) as fleet:
        changes = [
            f"swarm.{agent.name}.uri={uri}"
            for agent, uri in zip(room.agents, fleet.addresses, strict=True)
        ]
        changes.append(f"transport={{use: radio, cache: '{folder}'}}")
        arguments = ["run", mission, "--out", folder / "run", *(f"--set={c}" for c in changes)]
        program = [sys.executable, "-c", PROGRAM, flag, *arguments]
        with (folder / "output.txt").open("w") as output:
            flight = subprocess.Popen(
                [str(word) for word in program],
                stdout=output,
                stderr=output,
                env=os.environ | {"XDG_RUNTIME_DIR": str(folder)},  # out of reach of `star stop`
            )
        try:
            waited = wait_until(lambda: bool((fleet.height > TAKEN_OFF).any()), flight)
            if not waited:
                raise SystemExit((folder / "output.txt").read_text())
            time.sleep(at)
            inflict(fault, flight, flag)
            begun = time.monotonic()
            down = wait_until(lambda: bool((fleet.height < ON_FLOOR).all()), None, 2 * MAX_TIME)
            down_after = time.monotonic() - begun if down else np.inf
            time.sleep(2.0)  # a drone that rises again is not down
            if (fleet.height > ON_FLOOR).any():
                down_after = np.inf
            locked = int((fleet.simulator.drones["locked"] != 0).sum())
            status = flight.poll()
        finally:
            flight.kill()
            flight.wait()
        log = folder / "run" / "guardian.log"
        return Outcome(
            fault, seed, at, down_after, float(fleet.impact.max()), fleet.nearest, locked, status,
            log.read_text() if log.exists() else "",
        )  # fmt: skip


def wait_until(done: Any, flight: Any, patience: float = PATIENCE) -> bool:
    """Wait until something is true; return whether it is, before the flight's end."""
    end = time.monotonic() + patience
    while time.monotonic() < end and (flight is None or flight.poll() is None):
        if done():
            return True
        time.sleep(0.01)
    return False


def inflict(fault: str, flight: subprocess.Popen[bytes], flag: Path) -> None:
    """Let a fault happen now."""
    if fault in INSIDE:
        begin = flag.with_suffix(".new")
        begin.write_text(INSIDE[fault])
        begin.rename(flag)
        return
    guardian = int(
        subprocess.run(
            ["pgrep", "-P", str(flight.pid), "-f", "star_radio.guardian"],
            capture_output=True, text=True, check=True,
        ).stdout
    )  # fmt: skip
    stops = signal.SIGSTOP if fault.endswith("stop") else signal.SIGKILL
    if fault in {"sigkill", "sigstop", "both"}:
        os.kill(flight.pid, stops)
    if fault in {"guardian-kill", "guardian-stop", "both"}:
        os.kill(guardian, stops)


def cost(*, guarded: bool, room: Scene, cache: str, ticks: int) -> list[float]:
    """Return the time that the transport takes for each tick, ms: after it is due, and to send."""
    options = {"cache": cache, "guardian": guarded, "report_period": 0.01}
    radio = star_radio.make(room, **fill_defaults(options, OPTIONS))
    radio.connect()
    n = len(room.agents)
    still = Setpoint(np.zeros((n, 3)), np.zeros(n), np.ones(n, np.bool_))
    first = radio.wait(0.0)
    began = time.monotonic() - first
    took = []
    for i in range(1, ticks + 1):
        radio.wait(i * room.period)
        radio.receive()
        radio.send(still)
        took.append(1000 * (time.monotonic() - began - i * room.period))
    radio.close()
    return took


def costs(n: int, ticks: int) -> dict[str, float]:
    """Return the percentiles of the cost with and without a guardian, in turns, ms."""
    from radio import Drones  # in this folder: a fleet in a process of its own

    drones = Drones(n)
    room = drones.scene()
    figures: dict[str, list[float]] = {}
    with TemporaryDirectory() as cache:
        for _ in range(3):
            for guarded in (False, True):
                name = "guarded" if guarded else "in_process"
                figures.setdefault(name, []).extend(
                    cost(guarded=guarded, room=room, cache=cache, ticks=ticks)
                )
    drones.close()
    return {
        f"{name}_p{p}_ms": float(np.percentile(took, p))
        for name, took in figures.items()
        for p in (50, 99)
    }


def main() -> None:
    """Fly or measure, and print."""
    line = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    line.add_argument("--runs", type=int, default=30)
    line.add_argument("--first", type=int, default=0, help="first seed")
    line.add_argument("--only", default=",".join(KINDS))
    line.add_argument("--cost", action="store_true")
    line.add_argument("--agents", type=int, default=10, help="of --cost")
    line.add_argument("--ticks", type=int, default=600, help="of each of 6 flights of --cost")
    line.add_argument("--json", help="file to append each run to")
    options = line.parse_args()
    if options.cost:
        for name, value in costs(options.agents, options.ticks).items():
            print(f"{name:24} {value:8.3f}")
        return
    print("| fault | landed | down after, s: median, longest | fastest impact, m/s | nearest, m |")
    print("|---|---|---|---|---|", flush=True)
    for fault in options.only.split(","):
        runs = []
        for seed in range(options.first, options.first + options.runs):
            with TemporaryDirectory() as folder:
                runs.append(flown(fault, seed, Path(folder)))
            if options.json:
                with Path(options.json).open("a") as record:
                    record.write(json.dumps(runs[-1]._asdict()) + "\n")
        landed = sum(run.passed for run in runs)
        downs = [run.down_after for run in runs]
        print(
            f"| `{fault}` | {landed} of {len(runs)} | {np.median(downs):.1f}, {max(downs):.1f} | "
            f"{max(run.impact for run in runs):.2f} | {min(run.nearest for run in runs):.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
