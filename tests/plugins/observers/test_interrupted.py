"""The record of a program that was killed in flight: read, reported and exported as such."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from star_core import InputError, read_run
from star_core.commands.main import main
from tests.conftest import HOP, ROOM

TICKS = 40
KILLED = f"""
import os
from star_core import Registry, fly, hookimpl, load
from star_core.commands import Source
from star_record import spool

spool.FLUSH_PERIOD = 0.0

class Killer:
    ticks = 0

    @hookimpl(trylast=True)
    def star_ticked(self):
        self.ticks += 1
        if self.ticks == {TICKS}:
            os._exit(9)

registry = Registry()
registry.add(Killer(), Source("their-dist:killer"))
mission = load("hop.yaml", registry, ["mission.0.takeoff.until={{elapsed: 30}}"])
fly(mission, registry, folder="out")
"""


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("killed")
    for name, text in (("room", ROOM), ("hop", HOP)):
        (folder / f"{name}.yaml").write_text(text)
    subprocess.run([sys.executable, "-c", KILLED], check=False, cwd=folder, timeout=120)
    return folder / "out"


@pytest.fixture
def killed(original: Path, tmp_path: Path) -> Path:
    return copytree(original, tmp_path / "out")


def test_a_killed_flight_is_read_as_interrupted(
    killed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not (killed / "summary.json").exists()
    run = read_run(killed, flown=True)
    assert run.summary["outcome"] == "interrupted"
    assert run.agents == ("cf1", "cf2")
    assert len(run.arrays["time"]) in {TICKS - 1, TICKS}
    assert run.arrays["truth_position"].shape == (len(run.arrays["time"]), 2, 3)
    np.testing.assert_allclose(run.arrays["truth_position"][0, 0, :2], [-0.5, 0.0], atol=0.1)
    (takeoff,) = run.summary["steps"]
    assert (takeoff["verb"], takeoff["agents"]) == ("takeoff", ["cf1", "cf2"])
    assert takeoff["ended_s"] is None
    assert main(["export", str(killed), "--format", "csv"]) == 0
    assert main(["report", str(killed)]) == 0
    (page,) = killed.glob("*.html")
    assert "the program ended at " in page.read_text()
    capsys.readouterr()


@pytest.mark.parametrize("tail", [b"", b"\x00" * 7, b'{"torn": '])
def test_what_is_torn_at_the_end_is_left_out(killed: Path, tail: bytes) -> None:
    before = read_run(killed)
    for name in ("trajectory.rows", "timing.rows", "events.jsonl"):
        with (killed / name).open("ab") as file:
            file.write(tail)
    after = read_run(killed)
    assert after.summary == before.summary
    assert len(after.arrays["time"]) == len(before.arrays["time"])


def test_a_damaged_file_of_rows_is_refused(killed: Path) -> None:
    rows = killed / "trajectory.rows"
    rows.write_bytes(b"\x93NUMPY" + rows.read_bytes()[6:40])
    with pytest.raises(InputError, match=r"the record cannot be read: .*\[no-record\]"):
        read_run(killed)


def test_a_complete_record_has_no_unfinished_files(hop: Path) -> None:
    assert main(["run", str(hop / "hop.yaml"), "--json", "--out", str(hop / "out")]) == 0
    assert [file for file in (hop / "out").iterdir() if file.suffix in {".rows", ".jsonl"}] == []
