"""Workers are replaced when they die, and leave nothing behind when they end."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from star_ablate.flight import Job, fly_job
from star_ablate.reading import read
from star_ablate.workers import Processes, Worker
from star_core import Mission, Registry, StarError, load
from tests.plugins.commands.star_ablate.conftest import WRECKER, Write
from tests.waiting import eventually

pytestmark = pytest.mark.usefixtures("wrecker")


@pytest.fixture
def hop(study: Write) -> Callable[[str], Mission]:
    """Loads the mission with an avoider that does harm when it is made."""
    folder = study("").parents[1]

    def loaded(harm: str) -> Mission:
        options = f"avoider={{use: wrecker, made: '{harm}'}}"
        return load(folder / "hop.yaml", Registry(), [options])

    return loaded


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[Worker]:
    worker = Worker(tmp_path / "log.txt")
    yield worker
    worker.end()


def alive(process: int) -> bool:
    """Whether a process runs; one that has ended and was not waited for does not."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


@pytest.mark.extended
def test_a_worker_that_died_idle_is_replaced(worker: Worker, hop: Callable[[str], Mission]) -> None:
    worker.begin(0, Job(hop("raise")))
    assert worker.finish()[1].outcome == "failed"
    (process,) = [worker._process]
    assert process is not None
    process.kill()
    process.wait()
    worker.begin(1, Job(hop("exit")))
    index, result = worker.finish()
    assert (index, result.outcome) == (1, "crashed")
    assert result.reason == "its process ended with exit status 3"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads processes from /proc")
def test_ending_a_worker_ends_what_its_plugins_started(
    worker: Worker, hop: Callable[[str], Mission], tmp_path: Path
) -> None:
    log = tmp_path / "log.txt"
    worker.begin(0, Job(hop("breed")))
    (started,) = eventually(
        lambda: re.findall(r"^\d+$", log.read_text() if log.exists() else "", re.MULTILINE)
    )
    assert alive(int(started))
    worker.end()
    assert eventually(lambda: not alive(int(started)))


FLY = """
import sys
from pathlib import Path
from star_ablate.flight import Job
from star_ablate.workers import Processes
from star_core import Registry, load
if __name__ == "__main__":
    mission = load(sys.argv[1], Registry(), ["avoider={use: wrecker, made: 'breed'}"])
    list(Processes(1).fly_all([Job(mission)], Path(sys.argv[2])))
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads processes from /proc")
def test_workers_end_with_their_killed_parent(study: Write, tmp_path: Path, wrecker: Path) -> None:
    log, script = tmp_path / "log.txt", tmp_path / "fly.py"
    script.write_text(FLY)
    command = [sys.executable, str(script), str(study("").parents[1] / "hop.yaml"), str(log)]
    path = os.pathsep.join([str(wrecker), *sys.path])
    with subprocess.Popen(command, env=os.environ | {"PYTHONPATH": path}) as parent:
        (started,) = eventually(
            lambda: re.findall(r"^\d+$", log.read_text() if log.exists() else "", re.MULTILINE)
        )
        worker = int(Path(f"/proc/{started}/stat").read_text().rpartition(")")[2].split()[1])
        parent.kill()
    assert eventually(lambda: not alive(worker) and not alive(int(started)))


def test_code_that_changes_in_a_study_ends_it(study: Write, wrecker: Path, tmp_path: Path) -> None:
    text = "missions: [../hop.yaml]\nseeds: 1\nfactors: {a: {b: {avoider: wrecker}}}\n"
    (run,) = read(study(text), Registry()).runs()
    (wrecker / "star_wrecker.py").write_text(WRECKER + "\n# edited\n")
    with pytest.raises(
        StarError, match="since the study began: plugin 'star-wrecker:wrecker'; run"
    ):
        list(Processes(1).fly_all([run.job()], tmp_path / "log.txt"))


@pytest.mark.parametrize("harm", ["raise", "quit"])
def test_a_plugin_that_cannot_be_made_fails_its_run(
    harm: str, hop: Callable[[str], Mission]
) -> None:
    result = fly_job(Job(hop(harm)), Registry())
    assert (result.outcome, result.summary) == ("failed", None)
    assert "wrecker" in result.reason
    assert "harm" in result.reason


def test_an_error_of_our_own_fails_its_run_and_is_logged(
    hop: Callable[[str], Mission], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("star_core.fly", broken)
    result = fly_job(Job(hop("")), Registry())
    assert (result.outcome, result.summary) == ("failed", None)
    assert result.reason == "ZeroDivisionError: division by zero"
    assert "Traceback" in caplog.text


def test_without_tasks_nothing_is_started(tmp_path: Path) -> None:
    assert list(Processes(4).fly_all([], tmp_path / "log.txt")) == []
    assert not (tmp_path / "log.txt").exists()
