"""Studies fly on a running Dask cluster, whatever becomes of its workers."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TypeAlias

import pytest

from star_ablate.cluster import Cluster
from star_ablate.flight import Job, Result
from star_ablate.reading import read
from star_core import InputError, Registry, StarError
from star_core.commands.main import main
from tests.commands import Printed
from tests.plugins.commands.star_ablate.conftest import WRECKER, Write, install
from tests.waiting import eventually, free_port

pytestmark = pytest.mark.extended

pytest.importorskip("distributed")
DASK = str(Path(sys.executable).with_name("dask"))
TTL = {"DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "2s"}  # after which a silent worker is lost
NAPS = "missions: [../hop.yaml]\nseeds: {}\nfactors: {{nap: {{yes: {{avoider: {}}}}}}}\n"
FDS = Path("/proc/self/fd")
NAP = "{use: wrecker, made: nap}"

Start: TypeAlias = Callable[..., "Program"]


class Program:
    """A program of Dask, with a log."""

    def __init__(self, log: Path, *arguments: str, **environment: str) -> None:
        self.log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                [DASK, *arguments, "--no-dashboard", "--host", "127.0.0.1"],
                env=os.environ | environment,
                stdout=output,
                stderr=output,
            )

    def wait_for(self, text: str) -> None:
        assert eventually(lambda: text in self.log.read_text()), self.log.read_text()

    def end(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the plugin on this machine and on the workers."""
    return install(tmp_path_factory.mktemp("cluster") / "site", WRECKER)


@pytest.fixture(autouse=True)
def _with_plugin(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(site)
    monkeypatch.delitem(sys.modules, "star_wrecker", raising=False)


@contextmanager
def scheduler(folder: Path) -> Iterator[tuple[str, Program]]:
    """Start a scheduler, and yield its address."""
    address = f"tcp://127.0.0.1:{(port := free_port())}"
    program = Program(folder / "scheduler.log", "scheduler", "--port", str(port), **TTL)
    try:
        program.wait_for("Scheduler at:")
        yield address, program
    finally:
        program.end()


def worker(folder: Path, address: str, site: Path) -> Program:
    """Start a worker of one thread with a plugin."""
    paths = os.pathsep.join(filter(None, [str(site), os.environ.get("PYTHONPATH")]))
    log = folder / f"worker-{len([*folder.iterdir()])}.log"
    return Program(log, "worker", address, "--nthreads", "1", "--no-nanny", PYTHONPATH=paths)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory, site: Path) -> Iterator[str]:
    """The address of a scheduler with one worker."""
    folder = tmp_path_factory.mktemp("dask")
    with scheduler(folder) as (address, _):
        program = worker(folder, address, site)
        try:
            program.wait_for("Starting established connection")
            yield address
        finally:
            program.end()


@pytest.fixture
def join(cluster: str, tmp_path: Path, site: Path) -> Iterator[Callable[..., Program]]:
    """Starts another worker of the cluster."""
    programs: list[Program] = []

    def start(plugin: Path = site) -> Program:
        (folder := tmp_path / "workers").mkdir(exist_ok=True)
        program = worker(folder, cluster, plugin)
        programs.append(program)
        program.wait_for("Starting established connection")
        return program

    yield start
    for program in programs:
        program.end()


@pytest.fixture
def jobs(study: Write) -> Callable[[str, int], list[Job]]:
    """Returns the runs of a study of hops with an avoider."""

    def made(avoider: str, seeds: int) -> list[Job]:
        flown = read(study(NAPS.format(seeds, avoider)), Registry())
        return [run.job() for run in flown.runs()]

    return made


def flights(
    address: str, jobs: list[Job], limit: float | None = None
) -> Iterator[tuple[int, Result]]:
    with closing(Cluster(Registry(), address)) as engine:
        yield from engine.fly_all(jobs, Path(os.devnull), limit)


def listeners() -> set[str]:
    """Return the listening TCP sockets of this process, as Linux names them."""
    tables = [Path(f"/proc/self/net/{name}").read_text() for name in ("tcp", "tcp6")]
    rows = [line.split() for table in tables for line in table.splitlines()[1:]]
    listening = {f"socket:[{row[9]}]" for row in rows if row[3] == "0A"}
    return listening & {os.path.realpath(file).rpartition("/")[2] for file in FDS.iterdir()}


@pytest.mark.usefixtures("in_process")
def test_a_cluster_gives_the_results_of_one_machine(
    cluster: str, study: Write, tmp_path: Path
) -> None:
    path = study(
        "missions: [../hop.yaml, ../jump.yaml]\nseeds: 2\nmeasures: [steps, events, corrected]\n"
        "factors: {rate: {slow: {rate: 10}, fast: {mission.0.takeoff.height: 0.4}}}\n"
    )
    hop = path.parents[1] / "hop.yaml"
    hop.write_text(hop.read_text() + "  - include: {file: there/again.yaml}\n")
    (path.parents[1] / "there").mkdir()
    (path.parents[1] / "there/again.yaml").write_text(
        "star: 1\nmission: [takeoff: {height: 0.3}, follow: {file: there/line.csv}, land: {}]\n"
    )
    (path.parents[1] / "there/line.csv").write_text("x,y,z\n0,0,0.3\n0.2,0,0.3\n")
    command = ["ablate", str(path), "--quiet", "--out"]
    assert main([*command, str(tmp_path / "alone")]) == 0
    assert main([*command, str(tmp_path / "cluster"), "--scheduler", cluster]) == 0
    tables = [(tmp_path / name / "results.csv").read_bytes() for name in ("alone", "cluster")]
    assert tables[0] == tables[1]
    assert tables[0].count(b"completed") == 8


def test_star_starts_no_listener(cluster: str, jobs: Callable[[str, int], list[Job]]) -> None:
    before = listeners()
    assert [listeners() for _ in flights(cluster, jobs("none", 1))] == [before]


def test_runs_that_crash_or_hang_cost_no_worker(
    cluster: str, jobs: Callable[[str, int], list[Job]]
) -> None:
    harms = ("segfault", "raise")
    runs = [jobs(f"{{use: wrecker, made: {harm}}}", 1)[0] for harm in harms]
    ends = {harms[i]: (result.outcome, result.reason) for i, result in flights(cluster, runs)}
    assert ends["segfault"] == ("crashed", "its process ended with SIGSEGV")
    assert ends["raise"][0] == "failed"
    ((_, hung),) = flights(cluster, jobs("{use: wrecker, made: hang}", 1), 0.5)
    assert (hung.outcome, hung.reason) == ("crashed", "took longer than 0.5 s")
    assert [r.outcome for _, r in flights(cluster, jobs("none", 1))] == ["completed"]


@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.campaign)]
)
def test_runs_of_a_lost_worker_are_flown_elsewhere(
    number: signal.Signals,
    cluster: str,
    join: Callable[..., Program],
    jobs: Callable[[str, int], list[Job]],
) -> None:
    lost = join()
    runs = flights(cluster, jobs(NAP, 6))
    first, _ = next(runs)
    lost.process.send_signal(number)
    results = dict(runs)
    assert {*results, first} == {*range(6)}
    assert {result.outcome for result in results.values()} == {"completed"}


def test_a_worker_with_other_code_is_named_and_left_out(
    cluster: str,
    join: Callable[..., Program],
    jobs: Callable[[str, int], list[Job]],
    tmp_path: Path,
    capsys: Printed,
) -> None:
    runs = flights(cluster, jobs(NAP, 6))
    next(runs)
    join(install(tmp_path / "other", WRECKER + "\n# edited\n"))
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken/star_ablate.py").write_text("raise ImportError('not installed')\n")
    join(tmp_path / "broken")
    assert {result.outcome for _, result in runs} == {"completed"}
    text = capsys.readouterr().err
    assert "is left out: it differs in plugin 'star-wrecker:wrecker'\n" in text
    assert "is left out: STAR cannot be imported there: not installed; install" in text


def test_without_a_worker_of_the_same_code_nothing_flies(
    tmp_path: Path, jobs: Callable[[str, int], list[Job]]
) -> None:
    edited, broken = (install(tmp_path / name, WRECKER) for name in ("edited", "broken"))
    (edited / "star_wrecker.py").write_text(WRECKER + "\n# edited\n")
    (broken / "star_ablate.py").write_text("raise ImportError('not installed')")
    (tmp_path / "logs").mkdir()
    with scheduler(tmp_path / "logs") as (address, _):
        for site, why in (
            (edited, "it differs in plugin 'star-wrecker:wrecker'"),
            (broken, "STAR cannot be imported there"),
        ):
            program = worker(tmp_path / "logs", address, site)
            try:
                with pytest.raises(StarError, match=f"no worker can fly.*{why}"):
                    list(flights(address, jobs(NAP, 2)))
            finally:
                program.end()


def test_a_study_is_resumed_after_its_scheduler_died(
    cluster: str,
    site: Path,
    study: Write,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Printed,
) -> None:
    command = ["ablate", str(study(NAPS.format(4, NAP))), "--quiet", "--out", str(tmp_path / "out")]
    (tmp_path / "logs").mkdir()
    with scheduler(tmp_path / "logs") as (address, program), monkeypatch.context() as patch:
        flier = worker(tmp_path / "logs", address, site)
        patch.setattr("star_ablate.command.StudyProgress.add", lambda *_: program.end())
        try:
            assert main([*command, "--scheduler", address]) == 2
        finally:
            flier.end()
    text = capsys.readouterr().err
    assert f"scheduler {address}: the connection is lost [unreachable-scheduler]" in text
    assert f"1 of 4 runs are flown; to resume, add `--out {tmp_path / 'out'}`" in text
    assert main([*command, "--scheduler", cluster]) == 0
    with (tmp_path / "out/results.csv").open(encoding="utf-8") as file:
        assert [row["outcome"] for row in csv.DictReader(file)] == ["completed"] * 4
    assert len((tmp_path / "out/runs.jsonl").read_text().splitlines()) == 4


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (["--scheduler", "tcp://127.0.0.1:1"], "unreachable-scheduler"),
        (["--scheduler", "nonsense://x"], "unreachable-scheduler"),
        (["--scheduler-file", "nowhere.json"], "file-not-found"),
        (["--scheduler", "tcp://127.0.0.1:1", "--record"], "option-conflict"),
        (["--scheduler", "tcp://127.0.0.1:1", "--workers", "2"], "option-conflict"),
    ],
)
def test_a_cluster_that_cannot_be_used_is_refused(
    options: list[str],
    code: str,
    study: Write,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Printed,
) -> None:
    monkeypatch.setattr("star_ablate.cluster.CONNECT_TIMEOUT", 0.2)
    path = study("missions: [../hop.yaml]\n")
    assert main(["ablate", str(path), "--out", str(tmp_path / "out"), *options]) == 2
    assert f"[{code}]" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"star-swarm\[cluster\].*\[missing-package\]"):
        Cluster(Registry(), "tcp://127.0.0.1:1")
