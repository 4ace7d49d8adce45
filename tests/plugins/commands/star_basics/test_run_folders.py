"""Default folders of records, and the link to the newest."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from star_basics.latest_run import LatestRun
from star_core.commands.main import main
from star_core.messages.events import Flight
from star_core.testing import scene
from tests.commands import Printed


@pytest.mark.usefixtures("hop")
def test_the_newest_run_is_runs_latest() -> None:
    for seed in ("1", "2"):
        assert main(["run", "hop.yaml", "--seed", seed, "--json"]) == 0
    assert json.loads(Path("runs/latest/manifest.json").read_text())["seed"] == 2
    assert Path("runs/latest").is_symlink()
    assert len(list(Path("runs").iterdir())) == 3


@pytest.mark.usefixtures("hop")
def test_a_run_in_another_folder_is_not_the_latest() -> None:
    assert main(["run", "hop.yaml", "--out", "elsewhere/run", "--json"]) == 0
    assert not Path("elsewhere/latest").is_symlink()
    assert not Path("runs").exists()


def test_a_folder_that_is_called_latest_is_kept(tmp_path: Path) -> None:
    (tmp_path / "latest").mkdir()
    LatestRun().star_mission_started(Flight("hop", scene(1), {}, tmp_path / "first"))
    assert not (tmp_path / "latest").is_symlink()
    assert [path.name for path in tmp_path.iterdir()] == ["latest"]


def test_a_file_system_without_links_is_no_obstacle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_arguments: object) -> None:
        raise OSError

    monkeypatch.setattr(Path, "symlink_to", refuse)
    LatestRun().star_mission_started(Flight("hop", scene(1), {}, tmp_path / "first"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("hop")
@pytest.mark.parametrize("command", [["view"], ["report"], ["export", "--format", "csv"]])
def test_a_run_that_was_not_started_has_no_flight_to_show(
    command: list[str], capsys: Printed
) -> None:
    low = ["--set", "transport={use: sim, battery: 0.02}", "--set", "safety={battery_low: {}}"]
    assert main(["run", "hop.yaml", "--out", "low", *low]) == 1
    capsys.readouterr()
    assert main([*command, "low"]) == 2
    why = "no flight was recorded: not started: battery_low: cf1, cf2 at 3.16 V, below 3.2 V"
    assert f"low: {why} [no-record]" in capsys.readouterr().err


RADIO = ["transport=radio", *(f"swarm.cf{k}.uri=udp://127.0.0.1:{k}" for k in (1, 2))]


@pytest.mark.usefixtures("hop")
@pytest.mark.parametrize(
    ("changes", "status", "kind"), [([], 1, "warning: "), (RADIO, 2, "")], ids=["sim", "radio"]
)
def test_what_a_rehearsal_refuses_is_reported_before_a_run(
    changes: list[str], status: int, kind: str, capsys: Printed
) -> None:
    changes = [text for value in changes for text in ("--set", value)]
    arguments = ["--set", "mission.0.takeoff.timeout=0.2", *changes]
    assert main(["check", "hop.yaml", *arguments]) == 2
    refusal = capsys.readouterr().err.splitlines()[0]
    assert refusal.endswith("[timeout-too-short]")
    assert main(["run", "hop.yaml", "--no-record", *arguments]) == status
    location, message = refusal.split(": takeoff", 1)
    assert capsys.readouterr().err.splitlines()[0] == f"{location}: {kind}takeoff{message}"
