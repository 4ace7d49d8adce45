"""A long flight of many drones over the protocol, in real time, with recording and view.

``python benchmarks/soak.py`` prints a table, with ``--json`` one JSON object; its exit status is 1
if a bound is broken. ``star fleet`` serves the drones in one process; ``star run`` flies them by
the transport ``radio`` with its guardian, records them to MCAP, and shows them on a page that a
client reads. Each drone flies circles, at another speed than its neighbours, so close to theirs
that they avoid each other; its odometry does not drift, or they would soon be elsewhere.

- Lateness: the time of a tick less the time it was due, from ``timing.npz`` of the record; jitter:
  the deviation of the time between two ticks from the period. All ticks count.
- Memory: resident, sampled each second, of every process of the two commands. Its growth is the
  median of the last tenth over that of the tenth after the first minute (the first third, if that
  is shorter); the last `CLOSING` samples do not count.
- File handles and threads are compared at the same times; every warning of Python about a resource
  that was not closed counts, and so does a process that outlives the two commands.

It needs Linux (``/proc``). The processes have the default priority.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import re
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from printed import command_line
from view import read_page

TRANSPORT: Final = "radio"
MINUTES, DRONES, RATE = 10.0, 30, 20
MAX_JITTER: Final = 20.0  # ms, 99th percentile
MAX_GROWTH: Final = 0.05  # of the resident memory of a process
MAX_SLIP: Final = 0.5  # s, by which the simulated clock may fall behind
WARM: Final = 60.0  # s, after which nothing may grow
CLOSING: Final = 6  # last samples, while the drones land and the links are closed: not counted
MIN_ENDURANCE: Final = 60.0  # s, of a full battery
LAP: Final = 20.0  # s, after which the step is repeated
START_TIMEOUT: Final = 60.0  # s
EXIT_TIMEOUT: Final = 60.0  # s
SPACING: Final = 1.5  # m, of the centres of circles of 1 m
PORT: Final = 21850  # of the first drone
PAGE: Final = re.compile(r"(http://\S+) shows the flight")
SLIPPED: Final = re.compile(r"the clock was stopped for ([\d.]+) s")
UNCLOSED: Final = "ResourceWarning"
TICKS_PER_SECOND: Final = os.sysconf("SC_CLK_TCK")


def write(folder: Path, drones: int, minutes: float) -> Path:
    """Write a mission of drones on a square grid that fly circles; return its file."""
    side = math.ceil(math.sqrt(drones))
    places = [(SPACING * (i % side), SPACING * (i // side)) for i in range(drones)]
    high, lap = SPACING * (side - 1) + 2, min(LAP, 60 * minutes)
    (folder / "room.yaml").write_text(
        f"star: 1\nname: room\nfence: {{low: [-2, -2, 0], high: [{high}, {high}, 2.5]}}\n"
    )
    swarm = "".join(
        f"  cf{i + 1}: {{start: [{x}, {y}, 0], uri: 'udp://127.0.0.1:{PORT + i}'}}\n"
        for i, (x, y) in enumerate(places)
    )
    circles = "".join(
        f"          - follow: {{agents: cf{i + 1}, path: circle, size: 1.0, laps: 50,"
        f" centre: [{x}, {y}, 0.8], speed: {0.3 + 0.05 * (i % 3)},"
        f" until: {{elapsed: {lap}}}, timeout: 60}}\n"
        for i, (x, y) in enumerate(places)
    )
    mission = folder / "soak.yaml"
    mission.write_text(
        f"star: 1\nname: soak\nworld: room.yaml\nrate: {RATE}\n"
        f"transport: {{use: sim, profile: ideal, controller: ideal, noise: false,"
        f" endurance: {max(MIN_ENDURANCE, 120 * minutes):g}}}\n"
        "localizer: flow\nplanner: straight\navoider: orca\n"
        f"swarm:\n{swarm}"
        "mission:\n  - takeoff: {height: 0.8}\n"
        f"  - repeat:\n      times: {max(1, round(60 * minutes / lap))}\n      steps:\n"
        f"        - parallel:\n{circles}"
        "  - land: {}\n"
    )
    return mission


@dataclass
class Process:
    """A process of the two commands, and its samples.

    Attributes:
        role: What it is.
        rss: Resident memory, bytes, by the time of the sample, s.
        handles: Number of open files, likewise.
        threads: Number of threads, likewise.
        cpu: Processor time so far, s, likewise.
    """

    role: str
    rss: dict[float, int] = field(default_factory=dict)
    handles: dict[float, int] = field(default_factory=dict)
    threads: dict[float, int] = field(default_factory=dict)
    cpu: dict[float, float] = field(default_factory=dict)

    def sample(self, pid: int, now: float) -> None:
        """Take a sample of a process; one that has ended is left out."""
        proc = Path("/proc") / str(pid)
        try:
            state = dict(line.split(":", 1) for line in (proc / "status").read_text().splitlines())
            times = (proc / "stat").read_text().rpartition(")")[2].split()
            handles = sum(1 for _ in (proc / "fd").iterdir())
            rss, threads = int(state["VmRSS"].split()[0]) * 1024, int(state["Threads"])
        except (OSError, KeyError):  # it has ended
            return
        self.rss[now], self.threads[now], self.handles[now] = rss, threads, handles
        self.cpu[now] = (int(times[11]) + int(times[12])) / TICKS_PER_SECOND


ROLES: Final = {  # words of the command line
    "star_radio.guardian": "guardian", "star_mcap": "recorder", "star_view": "view",
    "'fleet'": "fleet", "'run'": "run",
}  # fmt: skip


def role(pid: int) -> str | None:
    """Return what a process of the two commands is; None for others."""
    try:
        line = (Path("/proc") / str(pid) / "cmdline").read_text()
    except OSError:
        return None
    return next((name for word, name in ROLES.items() if word in line), None)


def descendants(pid: int) -> Iterator[int]:
    """Yield a process and all below it."""
    yield pid
    try:
        children = [
            int(child)
            for task in (Path("/proc") / str(pid) / "task").iterdir()
            for child in (task / "children").read_text().split()
        ]
    except OSError:  # it has ended
        return
    for child in children:
        yield from descendants(child)


def star(command: str, *arguments: str) -> list[str]:
    """Return the command line of a command, which warns of resources that are not closed."""
    code = "import sys; from star_core.commands.main import main; sys.exit(main(sys.argv[1:]))"
    return [sys.executable, "-W", "always::ResourceWarning", "-c", code + f"  # '{command}'",
            command, *arguments]  # fmt: skip


@contextmanager
def running(arguments: Sequence[str], errors: Path) -> Iterator[subprocess.Popen[str]]:
    """Run a command, with its stderr in a file; interrupt it at the end."""
    with errors.open("w") as sink:
        process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=sink, text=True)
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
            try:
                process.wait(EXIT_TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def wait_for(pattern: re.Pattern[str], file: Path, process: subprocess.Popen[str]) -> str | None:
    """Wait until a line is in a file; return its first group, None if the process ends before."""
    until = time.monotonic() + START_TIMEOUT
    while time.monotonic() < until and process.poll() is None:
        if match := pattern.search(file.read_text()):
            return match[1]
        time.sleep(0.2)
    return None


@dataclass
class Soak:
    """What a flight left behind.

    Attributes:
        folder: Record of the run.
        processes: All that were seen, by process id.
        texts: What was written to stderr, by command.
        status: Exit status, by command.
        outlived: Roles of the processes that were still there after the end.
    """

    folder: Path
    processes: dict[int, Process] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    status: dict[str, int] = field(default_factory=dict)
    outlived: list[str] = field(default_factory=list)

    def sample(self, roots: Sequence[int], now: float) -> None:
        """Take a sample of all processes."""
        for root in roots:
            for pid in descendants(root):
                if pid not in self.processes and (name := role(pid)) is not None:
                    self.processes[pid] = Process(name)
                if pid in self.processes:
                    self.processes[pid].sample(pid, now)


def fly(folder: Path, drones: int, minutes: float) -> Soak:
    """Fly, and take samples until the flight is over.

    Raises:
        SystemExit: The flight does not begin.
    """
    mission, soak = write(folder, drones, minutes), Soak(folder / "run")
    files = {name: folder / f"{name}.err" for name in ("fleet", "run")}
    port = str(PORT)
    serve = star("fleet", str(mission), "--port", port)
    transport = f"transport={TRANSPORT}"
    run = star("run", str(mission), "--set", transport, "--out", str(soak.folder), "--view")
    context = multiprocessing.get_context("spawn")
    ready, done = context.Event(), context.Event()
    with running(serve, files["fleet"]) as fleet:
        assert fleet.stdout is not None
        if not fleet.stdout.readline():
            sys.exit(f"the fleet does not start: {files['fleet'].read_text()}")
        with running(run, files["run"]) as flight:
            address = wait_for(PAGE, files["run"], flight)
            if address is None:
                sys.exit(f"the flight does not start: {files['run'].read_text()}")
            reader = context.Process(target=read_page, args=(address, ready, done), daemon=True)
            reader.start()
            began = time.monotonic()
            while flight.poll() is None:
                soak.sample([fleet.pid, flight.pid], time.monotonic() - began)
                time.sleep(1.0)
            done.set()
            reader.join(EXIT_TIMEOUT)
    soak.status = {"fleet": fleet.returncode, "run": flight.returncode}
    soak.texts = {name: file.read_text() for name, file in files.items()}
    soak.outlived = [
        process.role for pid, process in soak.processes.items() if role(pid) == process.role
    ]
    return soak


def ends(samples: dict[float, Any], warm: float) -> tuple[float, float]:
    """Return the median of the tenth of the samples after `warm`, s, and of the last tenth."""
    values = [value for when, value in samples.items() if when >= warm][:-CLOSING]
    tenth = max(1, len(values) // 10)
    return statistics.median(values[:tenth]), statistics.median(values[-tenth:])


def figures(soak: Soak) -> dict[str, float]:
    """Return the figures of a flight by name."""
    with np.load(soak.folder / "timing.npz") as timing:
        times, late, took = timing["time"], 1e3 * timing["late"], 1e3 * timing["tick"]
        kinds = {name: 1e3 * timing[name] for name in timing.files
                 if name not in {"time", "late", "tick"}}  # fmt: skip
    jitter = abs(1e3 * np.diff(times) - 1e3 / RATE)
    values = {
        "ticks": float(len(times)),
        "flight (s)": float(times[-1] - times[0]),
        "lateness, p99 (ms)": float(np.percentile(late, 99)),
        "lateness, max (ms)": float(late.max()),
        "jitter, p99 (ms)": float(np.percentile(jitter, 99)),
        "jitter, max (ms)": float(jitter.max()),
        "ticks later than a period": float((late > 1e3 / RATE).sum()),
        "tick, median (ms)": float(np.median(took)),
        "tick, p99 (ms)": float(np.percentile(took, 99)),
        "overrun ticks (longer than a period)": float((took > 1e3 / RATE).sum()),
    }
    values |= {f"  {name}, median (ms)": float(np.median(each)) for name, each in kinds.items()}
    slipped = SLIPPED.search(soak.texts["fleet"])
    values["simulated clock behind (s)"] = float(slipped[1]) if slipped else 0.0
    lasted = max(when for process in soak.processes.values() for when in process.rss)
    warm = min(WARM, lasted / 3)
    for process in sorted(soak.processes.values(), key=lambda process: process.role):
        if sum(when >= warm for when in process.rss) <= CLOSING:  # it ended before
            continue
        name, cpu = process.role, process.cpu
        first, last = ends(process.rss, warm)
        values |= {
            f"{name}: memory (MB)": last / 1e6,
            f"{name}: growth of memory": last / first - 1,
            f"{name}: processor": (max(cpu.values()) - min(cpu.values())) / (max(cpu) - min(cpu)),
            f"{name}: more file handles": float(np.subtract(*ends(process.handles, warm)[::-1])),
            f"{name}: more threads": float(np.subtract(*ends(process.threads, warm)[::-1])),
        }
    values["resources not closed"] = float(sum(t.count(UNCLOSED) for t in soak.texts.values()))
    values["processes that outlived the flight"] = float(len(soak.outlived))
    values |= {f"exit status of star {name}": float(code) for name, code in soak.status.items()}
    return values


def bound(name: str) -> float | None:
    """Return the greatest allowed value of a figure; None for one without a bound."""
    for end, most in (
        ("lateness, p99 (ms)", MAX_JITTER),
        ("jitter, p99 (ms)", MAX_JITTER),
        ("growth of memory", MAX_GROWTH),
        ("behind (s)", MAX_SLIP),
        ("more file handles", 0.0),
        ("more threads", 0.0),
        ("not closed", 0.0),
        ("outlived the flight", 0.0),
    ):
        if name.endswith(end):
            return most
    return 0.0 if name.startswith("exit status") else None


def main() -> int:
    """Print the figures; return 1 if a bound is broken."""
    options = command_line(__doc__, minutes=MINUTES, drones=DRONES).parse_args()
    with TemporaryDirectory() as folder:
        soak = fly(Path(folder), options.drones, options.minutes)
        if not (soak.folder / "timing.npz").exists():
            sys.exit("the flight left no record:\n" + "\n".join(soak.texts.values()))
        values = figures(soak)
    broken = [
        name for name, value in values.items()
        if (most := bound(name)) is not None and not value <= most
    ]  # fmt: skip
    if options.json:
        print(json.dumps(values | {"broken": broken}))
        return bool(broken)
    for name, value in values.items():
        most = bound(name)
        goal = "" if most is None else f"   (at most {most:g})"
        print(f"{name:44}{value:12.4g}{goal}{' BROKEN' * (name in broken)}")
    if broken:
        print("\n".join(text.strip()[-2000:] for text in soak.texts.values()), file=sys.stderr)
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
