"""Studies: planning, 10,000 runs on 64 workers of a cluster, their report, and real flights.

``python benchmarks/study.py`` prints a table, with ``--json`` one JSON object; ``--only`` measures
some of it. Everything runs on this machine; other load on it is part of every wall time.

- ``plan``: processor time to read a study and check its missions, as conditions x seeds.
- ``cluster``: a study of `RUNS` runs on `WORKERS` workers of Dask, of one thread each, in a few
  processes. **No run flies**: a worker sleeps `NAP` seconds and returns the summary of a flight
  that was flown once, with some noise. Efficiency is the sum of all sleeps over the wall time of
  the study, its table included, times the number of workers. Memory is the parent's peak.
- ``memory``: peak of a process that keeps and tabulates the results of `RUNS` such runs, which an
  engine in it returns at once.
- ``report``: of that study: processor time to write it, its size and, where playwright is
  installed, the wall time until its first figure is shown in Chromium.
- ``flights``: wall time of a study of `FLIGHTS` real flights on one core over that on two.
- ``overhead``: processor time of a run in a study, on this machine and on a cluster, over that of
  a bare flight in a loop, of short flights: the time of 3 n runs in all processes less that of n
  runs, over 2 n, so that starts do not count.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from star_ablate.cluster import Cluster
from star_ablate.command import _fly
from star_ablate.flight import Job, Result
from star_ablate.reading import read
from star_ablate.workers import Engine, Processes
from star_core import Registry, fly, load

ROOT: Final = Path(__file__).parents[1]
STAR: Final = Path(sys.executable).with_name("star")
MISSION: Final = "first_flight"
RUNS, WORKERS, NAP = 10_000, 64, 1.0  # s
PROCESSES = 8  # of the workers
PLANS = ((100, 100), (1000, 10))  # conditions, seeds
FLIGHTS = 192
SHORT_FLIGHTS = 40  # n
SHORT: Final = "mission: [{takeoff: {height: 0.3}}, {land: {}}]"
"""Of the flights beside which a run's cost is seen; it does not depend on their length."""
GOALS: Final = {
    "plan (s)": "<= 10", "efficiency": ">= 0.9", "memory (MB)": "<= 500", "report (MB)": "<= 5",
    "report opens (s)": "<= 3", "two cores over one": ">= 1.8", "local overhead (ms)": "<= 50",
    "dask overhead (ms)": "<= 150",
}  # fmt: skip
START_WORKERS: Final = """\
import asyncio, sys
from distributed import Worker
async def serve():
    workers = [Worker(sys.argv[1], nthreads=1, dashboard=False) for _ in range(int(sys.argv[2]))]
    await asyncio.gather(*workers)
    await asyncio.gather(*[worker.finished() for worker in workers])
asyncio.run(serve())
"""


def nap(text: str) -> str:
    """Sleep in place of the flight of an order; return the summary of another flight."""
    from distributed import get_worker

    time.sleep(float(os.environ["STAR_NAP"]))
    content = ["completed", "", 1.0, noisy_summary(json.loads(text)["seed"])]
    return json.dumps([get_worker().address, content])


def noisy_summary(seed: int) -> dict[str, Any]:
    """Return the summary of a flight with noise."""
    summary: dict[str, Any] = json.loads(Path(os.environ["STAR_SUMMARY"]).read_text())
    noise = random.Random(seed)  # noqa: S311 -- no secret
    summary["flight_time_s"] += noise.gauss()
    summary["min_separation_m"] *= noise.uniform(0.9, 1.1)
    return summary


class Instant:
    """An engine whose runs are over at once."""

    size = 1

    def fly_all(
        self, jobs: Sequence[Job], *_: object, **__: object
    ) -> Generator[tuple[int, Result]]:
        for index, job in enumerate(jobs):
            summary = noisy_summary(job.mission.scene.seed)
            yield index, Result("completed", "", 1.0, summary)

    def close(self) -> None:
        """Do nothing."""


def write(folder: Path, conditions: int, seeds: int, settings: str = "") -> Path:
    """Write a study of `MISSION` with several radii of `orca` into a folder."""
    shutil.copytree(ROOT / "missions/worlds", folder / "worlds", dirs_exist_ok=True)
    shutil.copy(ROOT / f"missions/{MISSION}.yaml", folder)
    (folder / "studies").mkdir(exist_ok=True)
    levels = ", ".join(
        f"r{k}: {{avoider: {{use: orca, radius: {0.2 + 0.1 * k / conditions:.6f}}}, {settings}}}"
        for k in range(conditions)
    )
    path = folder / "studies/study.yaml"
    path.write_text(
        f"star: 1\nname: study\nmissions: [../{MISSION}.yaml]\n"
        f"seeds: {seeds}\nfactors: {{radius: {{{levels}}}}}\n"
        "measures: [flight_time_s, min_separation_m, path_length_m.total]\n"
    )
    return path


def plans(folder: Path) -> Iterator[tuple[str, float]]:
    """Yield the processor time of planning, s."""
    for conditions, seeds in PLANS:
        path, registry = write(folder, conditions, seeds), Registry()
        begun = time.process_time()
        runs = len(list(read(path, registry).runs()))
        yield f"plan (s) {conditions} x {seeds} = {runs} runs", time.process_time() - begun


@contextmanager
def cluster(workers: int, processes: int, **environment: str) -> Iterator[tuple[str, list[int]]]:
    """Start a scheduler and workers; yield its address and the numbers of all processes."""
    environ = os.environ | {"PYTHONPATH": str(ROOT / "benchmarks")} | environment
    with TemporaryDirectory() as folder:
        file = Path(folder, "scheduler.json")
        dask = [str(STAR.with_name("dask")), "scheduler", "--host", "127.0.0.1", "--port", "0"]
        command = [*dask, "--no-dashboard", "--scheduler-file", str(file)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        programs = [subprocess.Popen(command, env=environ, **quiet)]  # type: ignore[call-overload]
        try:
            while not file.exists() or not file.read_text().endswith("}"):
                time.sleep(0.05)
            address = str(json.loads(file.read_text())["address"])
            for _ in range(processes):
                start = [sys.executable, "-c", START_WORKERS, address, str(workers // processes)]
                programs.append(subprocess.Popen(start, env=environ, **quiet))  # type: ignore[call-overload]
            wait_for_workers(address, workers)
            yield address, [program.pid for program in programs]
        finally:
            for program in programs:
                program.kill()
                program.wait()


def wait_for_workers(address: str, number: int) -> None:
    """Wait until a scheduler has a number of workers."""
    from distributed import Client

    connect: Any = Client
    with closing(connect(address, set_as_default=False)) as client:
        client.wait_for_workers(number)


def parent(address: str, path: str, out: str) -> tuple[float, float, float]:
    """Fly a study of sleeps; return wall time, s, peak memory, MB, and processor time, s.

    `address` is that of the cluster, or empty: then the runs are over at once.
    """
    from study import nap as task  # by which workers can import it

    study = read(Path(path), registry := Registry())
    cluster = Cluster(registry, address, task=task) if address else Instant()
    with closing(cluster) as engine:
        begun = time.perf_counter()
        _fly(study, Path(out), engine)
        wall_time = time.perf_counter() - begun
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return wall_time, memory, time.process_time()


def ready(folder: Path) -> tuple[Path, Path]:
    """Write a study of `RUNS` runs, and the summary of one; return their files."""
    path = write(folder, *((10, RUNS // 10) if RUNS >= 10 else (1, RUNS)))  # noqa: PLR2004 -- ten
    summary, registry = folder / "summary.json", Registry()
    if not summary.exists():
        flight = fly(load(f"missions/{MISSION}.yaml", registry), registry)
        summary.write_text(json.dumps(flight))
    return path, summary


def start_parent(address: str, path: Path, out: Path, summary: Path) -> tuple[float, float, float]:
    """Run `parent` in a process of its own."""
    command = [sys.executable, __file__, "--parent", address, str(path), str(out)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True,
                          stderr=subprocess.DEVNULL,
                          env=os.environ | {"STAR_SUMMARY": str(summary)})  # fmt: skip
    wall_time, memory, spent = json.loads(done.stdout)
    return wall_time, memory, spent


def memory(folder: Path) -> Iterator[tuple[str, float]]:
    """Yield what the results of a study take."""
    path, summary = ready(folder)
    _, peak, spent = start_parent("", path, folder / "out", summary)
    yield f"memory (MB), {RUNS} results", peak
    yield f"processor time (s), {RUNS} results", spent


def sleeps(folder: Path) -> Iterator[tuple[str, float]]:
    """Yield the figures of a study of sleeps."""
    path, summary = ready(folder)
    files = {"STAR_NAP": str(NAP), "STAR_SUMMARY": str(summary)}
    with cluster(WORKERS, PROCESSES, **files) as (address, processes):
        before = spent_by(processes)
        wall_time, peak, of_parent = start_parent(address, path, folder / "slept", summary)
        spent = spent_by(processes) - before  # the parent's too, a child of this process
    efficiency = RUNS * NAP / (WORKERS * wall_time)
    yield f"efficiency, {RUNS} sleeps of {NAP:g} s, {WORKERS} workers", efficiency
    yield "memory (MB), the same", peak
    yield "processor time for a run, parent (ms)", 1000 * of_parent / RUNS
    yield "processor time for a run, all (ms)", 1000 * spent / RUNS


def report(folder: Path) -> Iterator[tuple[str, float]]:
    """Yield the figures of the report of the study of sleeps."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([STAR, "report", folder / "out"], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    yield "report written (s)", after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    page = folder / "out/report.html"
    yield "report (MB)", page.stat().st_size / 1e6
    try:
        from report import opened

        yield "report opens (s)", opened(page, 1)["open_s"]
    except ImportError:
        print("report opens: playwright is not installed", file=sys.stderr)


def flown(path: Path, out: Path, engine: Engine) -> float:
    """Fly a study and return its wall time, s."""
    study = read(path, Registry())
    begun = time.perf_counter()
    with closing(engine):
        _fly(study, out, engine)
    return time.perf_counter() - begun


def flights(folder: Path) -> Iterator[tuple[str, float]]:
    """Yield how much faster two cores are than one."""
    path = write(folder, 1, FLIGHTS)
    single = flown(path, folder / "one", Processes(1))
    double = flown(path, folder / "two", Processes(2))
    yield f"two cores over one, {FLIGHTS} flights", single / double


def spent_by(processes: list[int]) -> float:
    """Return the processor time of this process, of processes and of their children, s."""
    import psutil

    total = sum(os.times()[:4])
    for number in processes:
        process = psutil.Process(number)
        for each in [process, *process.children(recursive=True)]:
            total += sum(each.cpu_times()[:4])
    return total


def per_run(folder: Path, name: str, engine: Callable[[], Engine], processes: list[int]) -> float:
    """Return the processor time of a run in a study, s, without that of starts."""
    spent = []
    for n in (SHORT_FLIGHTS, 3 * SHORT_FLIGHTS):
        path = write(folder, 1, n, SHORT)
        before = spent_by(processes)
        flown(path, folder / f"{name}-{n}", engine())
        spent.append(spent_by(processes) - before)
    return (spent[1] - spent[0]) / (2 * SHORT_FLIGHTS)


def overheads(folder: Path) -> Iterator[tuple[str, float]]:
    """Yield what a run costs in a study beside a bare flight, ms."""
    registry = Registry()
    path = write(folder, 1, 1, SHORT)
    mission = next(read(path, registry).runs()).mission()
    fly(mission.with_seed(0), registry)
    begun = time.process_time()
    for seed in range(SHORT_FLIGHTS, 3 * SHORT_FLIGHTS):
        fly(mission.with_seed(seed), registry)
    bare = (time.process_time() - begun) / (2 * SHORT_FLIGHTS)
    yield "bare flight (ms)", 1000 * bare
    local = per_run(folder, "local", lambda: Processes(1), [])
    yield "local overhead (ms)", 1000 * (local - bare)
    with cluster(1, 1) as (address, processes):
        dask = per_run(folder, "dask", lambda: Cluster(Registry(), address), processes)
    yield "dask overhead (ms)", 1000 * (dask - bare)


MEASURES: Final = {
    "plan": plans, "memory": memory, "report": report, "cluster": sleeps, "flights": flights,
    "overhead": overheads,
}  # fmt: skip


def main() -> None:
    """Print the figures."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--json", action="store_true")
    arguments.add_argument("--only", nargs="+", choices=MEASURES, default=list(MEASURES))
    arguments.add_argument("--parent", nargs=3, help=argparse.SUPPRESS)
    options = arguments.parse_args()
    if options.parent:
        print(json.dumps(parent(*options.parent)))
        return
    figures: dict[str, float] = {}
    with TemporaryDirectory() as home:
        for name in options.only:
            for label, value in MEASURES[name](Path(home)):
                figures[label] = value
                if not options.json:
                    goal = next((g for k, g in GOALS.items() if label.startswith(k)), "")
                    print(f"{label:60} {value:10.3f}  {goal}", flush=True)
    load_average = os.getloadavg()
    if options.json:
        print(json.dumps(figures | {"load": load_average}))
    else:
        print("load average at the end:", *(f"{value:.1f}" for value in load_average))


if __name__ == "__main__":
    main()
